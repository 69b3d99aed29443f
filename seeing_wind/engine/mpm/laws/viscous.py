"""The viscous part of a Kelvin-Voigt solid: stress in proportion to the strain rate, added to that of the elastic laws.

    tau_v = eta (2 d + (lam / mu) tr(d) I),    d = (C + C^T) / 2

with the velocity gradient C from the particle's last g2p and the shear viscosity eta [Pa s]. It is the linear elastic stress of the strain
that accumulates within the retardation time eta / mu [s], so every small motion loses energy in proportion to its stiffness: a mode of
angular frequency omega has the damping ratio omega eta / (2 mu) and the loss factor omega eta / mu. d turns with the body and is zero in a
rigid motion, and tau_v is symmetric, so momentum and angular momentum are conserved.

Source: Kelvin and Voigt's solid as in Christensen, "Theory of viscoelasticity", section 1.5.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from .plasticity import VON_MISES


@ti.func
def is_damped(law, viscosity):
    """Whether a particle has a viscous stress; in plastic laws `viscosity` is that of the flow instead."""
    return law < VON_MISES and viscosity > 0.0


@ti.func
def doubled_rate(A, ratio):
    """A + A^T + ratio tr(A) I."""
    swell = ratio * (A[0, 0] + A[1, 1] + A[2, 2])
    twice = A + A.transpose()
    for i in ti.static(range(3)):
        twice[i, i] += swell
    return twice


@ti.func
def viscous(C, mu, lam, viscosity):
    """tau_v [Pa]."""
    return viscosity * doubled_rate(C, lam / mu)


@ti.func
def viscous_adjoint(C, mu, lam, viscosity, tau_bar):
    """C_bar, mu_bar, lam_bar, viscosity_bar. tau_v is linear in C, by a self-adjoint map."""
    ratio = lam / mu
    swell = (C[0, 0] + C[1, 1] + C[2, 2]) * (tau_bar[0, 0] + tau_bar[1, 1] + tau_bar[2, 2])
    shear = 0.0 * mu
    for i, j in ti.static(ti.ndrange(3, 3)):
        shear += tau_bar[i, j] * (C[i, j] + C[j, i])
    lam_bar = viscosity * swell / mu
    return viscosity * doubled_rate(tau_bar, ratio), -ratio * lam_bar, lam_bar, shear + ratio * swell
