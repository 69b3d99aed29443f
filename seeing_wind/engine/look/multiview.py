"""The Gaussians of a body that several posed cameras saw at one moment: what only a further view shows is added, then all are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..observe.object.shape.relief import clean_mask
from ..progress import Progress
from ..records import Body, Observation
from .covering import joined, uncovered
from .first_frame import View, fit_views


def with_views(body: Body, first: Observation, further: Sequence[Observation], progress: Progress) -> tuple[Body, float]:
    """The body with Gaussians for all that frame 0 of any view shows, fitted by splatting on all of them.

    Args:
        body: built from the first view, whose surface the other cameras' rays meet.

    Returns:
        the body, and the PSNR inside the first view's mask [dB].

    Raises:
        ObjectError: a further view whose mask is empty.
    """
    views = [View(one.camera, clean_mask(one.masks[0]), one.image, one.background) for one in (first, *further)]
    gaussians = body.gaussians
    for view in views[1:]:
        gaussians = joined(gaussians, uncovered(body, gaussians, view.camera, view.mask, view.image))
    fitted, quality = fit_views(gaussians, views, progress)
    return replace(body, gaussians=fitted), quality
