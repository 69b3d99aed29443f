"""The laws' functions called from NumPy, in either precision. No postponed annotations: the compiler reads them.

`material` is (n, 2) mu, lam [Pa] for stresses and (n, 4) mu, yield stress, viscosity, dt for flow; F (n, 3, 3).
"""

import numpy as np

from seeing_wind.engine.mpm.compiler import device, ti
from seeing_wind.engine.mpm.compiler.settings import compiled_in, compiled_sooner
from seeing_wind.engine.mpm.laws import constitutive, plasticity

array = ti.types.ndarray()


@ti.func
def matrix(F: ti.template(), p):
    return ti.Matrix([[F[p, i, j] for j in ti.static(range(3))] for i in ti.static(range(3))])


@ti.func
def put(value, out: ti.template(), p):
    for i, j in ti.static(ti.ndrange(3, 3)):
        out[p, i, j] = value[i, j]


@ti.kernel
def _stress(law: ti.i32, material: array, F: array, tau_out: array):
    for p in range(F.shape[0]):
        tau, _known = constitutive.kirchhoff(True, law, matrix(F, p), material[p, 0], material[p, 1])
        put(tau, tau_out, p)


@ti.kernel
def _stress_both_ways(
    law: ti.i32, material: array, F: array, tau_bar: array, tau_out: array, F_bar_out: array, material_bar_out: array
):  # fmt: skip
    for p in range(F.shape[0]):
        tau, F_bar, mu_bar, lam_bar = constitutive.kirchhoff_both_ways(
            True, law, matrix(F, p), material[p, 0], material[p, 1], matrix(tau_bar, p)
        )
        put(tau, tau_out, p)
        put(F_bar, F_bar_out, p)
        material_bar_out[p, 0], material_bar_out[p, 1] = mu_bar, lam_bar


@ti.kernel
def _flow(law: ti.i32, material: array, F: array, F_out: array):
    for p in range(F.shape[0]):
        put(plasticity.plastic_flow(law, matrix(F, p), material[p, 0], material[p, 1], material[p, 2], material[p, 3]), F_out, p)


@ti.kernel
def _flow_adjoint(law: ti.i32, material: array, F: array, F_next_bar: array, F_bar_out: array, material_bar_out: array):
    for p in range(F.shape[0]):
        F_bar, mu_bar, yield_bar, viscosity_bar = plasticity.plastic_flow_adjoint(
            law, matrix(F, p), material[p, 0], material[p, 1], material[p, 2], material[p, 3], matrix(F_next_bar, p)
        )
        put(F_bar, F_bar_out, p)
        material_bar_out[p, 0], material_bar_out[p, 1], material_bar_out[p, 2] = mu_bar, yield_bar, viscosity_bar


def _call(kernel, real, first, *arrays):
    device.start()
    with compiled_sooner(), compiled_in(real):
        kernel(*first, *arrays)


def _ready(array, real, shape=None):
    array = np.asarray(array, dtype=real)
    return np.ascontiguousarray(array if shape is None else np.broadcast_to(array, shape))


def stress(law, F, material, real=np.float64):
    """tau (n, 3, 3)."""
    F = _ready(F, real)
    out = np.empty_like(F)
    _call(_stress, real, (constitutive.LAWS[law],), _ready(material, real, (len(F), 2)), F, out)
    return out


def stress_both_ways(law, F, material, tau_bar, real=np.float64):
    """tau (n, 3, 3), F_bar (n, 3, 3), material_bar (n, 2)."""
    F = _ready(F, real)
    tau, out, material_bar = np.empty_like(F), np.empty_like(F), np.empty((len(F), 2), real)
    arguments = _ready(material, real, (len(F), 2)), F, _ready(tau_bar, real), tau, out, material_bar
    _call(_stress_both_ways, real, (constitutive.LAWS[law],), *arguments)
    return tau, out, material_bar


def stress_adjoint(law, F, material, tau_bar, real=np.float64):
    """F_bar (n, 3, 3), material_bar (n, 2)."""
    return stress_both_ways(law, F, material, tau_bar, real)[1:]


def flow(law, F, material, real=np.float64):
    """F (n, 3, 3) after plastic flow."""
    F = _ready(F, real)
    out = np.empty_like(F)
    _call(_flow, real, (constitutive.LAWS[law],), _ready(material, real, (len(F), 4)), F, out)
    return out


def flow_adjoint(law, F, material, F_next_bar, real=np.float64):
    """F_bar (n, 3, 3), material_bar (n, 4), zero for dt."""
    F = _ready(F, real)
    out, material_bar = np.empty_like(F), np.zeros((len(F), 4), real)
    arguments = _ready(material, real, (len(F), 4)), F, _ready(F_next_bar, real), out, material_bar
    _call(_flow_adjoint, real, (constitutive.LAWS[law],), *arguments)
    return out, material_bar


def rotations(rng, count):
    """Random rotations (count, 3, 3)."""
    Q, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    return Q * np.sign(np.linalg.det(Q))[:, None, None]


def deformations(rng, count=12, size=0.25):
    """Rotated random stretches (count, 3, 3)."""
    return rotations(rng, count) @ (np.eye(3) + size * rng.uniform(-1, 1, size=(count, 3, 3)))


def stretched(rng, stretches, count=4):
    """V diag(stretches) W^T with random rotations V, W, (count, 3, 3)."""
    return rotations(rng, count) @ np.diag(stretches) @ rotations(rng, count)


def delicate(rng):
    """Deformations at which formulas that divide by differences of stretches break, (n, 3, 3)."""
    cases = [np.eye(3)[None], rotations(rng, 4), 0.8 * rotations(rng, 2), 1.1 * rotations(rng, 2)]
    cases += [np.diag(s)[None] for s in ((1.2, 1.2, 0.9), (0.9, 1.2, 1.2), (1.2, 0.9, 1.2), (0.7, 1.0, 1.3))]
    for gap in (0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3):
        for base in ((1.2, 1.2, 0.9), (0.8, 0.8, 1.1), (1.1, 1.1, 1.1), (1.0, 1.0, 1.0)):
            cases.append(stretched(rng, np.array(base) + gap * np.array([1.0, -0.3, 0.4])))
    return np.concatenate(cases)
