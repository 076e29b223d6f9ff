"""Options of surface models."""

from __future__ import annotations

from ..foundation.options import option, options


@options
class SurfaceOptions:
    """How a surface model is matched."""

    most_pairs: int = option(
        4,
        "Largest number of stereo pairs; the best ones are chosen by convergence, overlap, sun, season and common "
        "tie points",
        minimum=1,
    )
    tile_cells: int = option(
        512,
        "Side of the tiles that are matched together",
        name="tile",
        minimum=64,
        maximum=2048,
        unit="cells",
        advanced=True,
        metavar="N",
    )
    largest_sigma_m: float | None = option(
        None,
        "Largest standard deviation of a height; cells with a larger one become nodata. By default all are kept",
        name="max-sigma",
        minimum=1e-3,
        unit="m",
        metavar="M",
    )
