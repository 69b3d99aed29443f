"""At rest: the strain of a hanging sheet, and the shape of a strip that bends under its own weight."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from seeing_wind.engine.materials import Sheet
from seeing_wind.engine.mpm.shell import advance, at_rest, shell_of
from seeing_wind.engine.mpm.shell import substep as room

G = np.array([0.0, 0.0, -9.81])


def settled(shell, substeps=100, dt=0.02):
    """Where a shell with much damping comes to rest."""
    state = at_rest(shell)
    for _ in range(substeps):
        state, _ = advance(shell, state, dt=dt, gravity=G)
    assert np.abs(state.v).max() < 5e-3
    return state.x


@pytest.mark.parametrize("kind", ["grid", "irregular"])
def test_a_hanging_sheet_has_the_strain_of_its_weight(make, kind):
    """Green's strain e at a height z above the lower edge: (1 + e) Y e = rho g z, as St. Venant's stress counts per length at rest."""
    Y, rho, length = 200.0, 0.4, 1.0
    x, faces = make[kind](length, 0.5, 16, 8)
    x = np.stack([x[:, 1], np.zeros(len(x)), x[:, 0]], 1)
    shell = shell_of(x, faces, Sheet(rho, 1e-3, Y, 1e-5, loss_factor=2.0, poisson_ratio=0.0), pinned=x[:, 2] > length - 1e-9)
    moved = settled(shell)
    z = np.linspace(0.0, length, 2001)
    stretch = np.ones_like(z)
    for _ in range(50):  # stretch lam: Y (lam² - 1) / 2 lam = rho g z
        stretch = np.sqrt(1.0 + 2.0 * rho * 9.81 * z / (Y * stretch))
    drop = np.concatenate([[0.0], np.cumsum(0.5 * (stretch[1:] + stretch[:-1]) - 1.0)]) * (z[1] - z[0])
    expected = np.interp(x[:, 2], z, drop - drop[-1]) + x[:, 2]
    lowest = x[:, 2] < 1e-9
    np.testing.assert_allclose(moved[:, 2], expected, atol=0.01 * drop[-1])
    assert length - moved[lowest, 2].mean() == pytest.approx(length + drop[-1], rel=1e-4)


def elastica(length: float, stiffness: float, weight: float) -> tuple[float, float]:
    """Tip (along, down) [m] of a heavy strip clamped level: B theta'' = -w (L - s) cos(theta), theta(0) = theta'(L) = 0."""
    s = np.linspace(0.0, length, 201)
    solution = solve_bvp(
        lambda s, y: np.stack([y[1], -weight * (length - s) * np.cos(y[0]) / stiffness]),
        lambda a, b: np.array([a[0], b[1]]), s, np.zeros((2, len(s))), tol=1e-8,
    )  # fmt: skip
    assert solution.success
    theta = solution.sol(s)[0]
    return float(np.trapezoid(np.cos(theta), s)), float(np.trapezoid(np.sin(theta), s))


@pytest.mark.parametrize(
    ("kind", "columns"),
    [(kind, columns) for kind in ("grid", "irregular") for columns in (8, 16)]
    + [("irregular", 32), pytest.param("grid", 32, marks=pytest.mark.slow)],
)
def test_a_cantilever_bends_like_the_heavy_elastica(make, monkeypatch, kind, columns):
    """Cotton over 2.6 times its bending length (B/w)^(1/3): half the strip hangs."""
    length, B, rho = 0.05, 8e-6, 0.12
    monkeypatch.setattr(room, "EXACT", 1e-3)
    x, faces = make[kind](length, 0.02, columns, max(4, columns // 2))
    edge = np.flatnonzero(x[:, 0] < 1e-9)
    edge = edge[np.argsort(x[edge, 1])]
    # one more row of vertices behind the edge: a clamp takes faces, not only points
    behind = len(x) + np.arange(len(edge))
    x = np.vstack([x, x[edge] - [length / columns, 0.0, 0.0]])
    faces = np.vstack([faces, np.stack([behind[:-1], edge[:-1], edge[1:]], 1), np.stack([behind[:-1], edge[1:], behind[1:]], 1)])
    shell = shell_of(x, faces, Sheet(rho, 3.5e-4, 1.2e4, B, loss_factor=1.5, poisson_ratio=0.0), pinned=x[:, 0] < 1e-9)
    tip = settled(shell)[x[:, 0] > length - 1e-9].mean(axis=0)
    along, down = elastica(length, B, rho * 9.81)
    assert -tip[2] == pytest.approx(down, rel=0.05)
    assert tip[0] == pytest.approx(along, rel=0.05)
