"""Whether the inputs of a block can be what they claim, asked once for every algorithm that adjusts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from ...hrsi_engine.block.block import Block
from ...hrsi_engine.foundation.errors import InputError, SolveError
from ...hrsi_engine.foundation.reasons import Level, Reason
from ...hrsi_engine.io.dems import open_dem
from ...hrsi_engine.plausibility import check_block
from ..files.terrain import dem_datum


def input_reasons(block: Block, options: Mapping[str, Any]) -> list[Reason]:
    """Return what in a block's inputs a careful operator would have to look into, worst first."""
    dem = options.get("dem")
    return check_block(block, surface=open_dem(dem, dem_datum(options)) if dem else None)


@contextmanager
def explained_by(reasons: Sequence[Reason]) -> Iterator[None]:
    """Say what is wrong with the inputs where an adjustment fails on them, not how the adjustment failed."""
    try:
        yield
    except (SolveError, InputError) as error:
        worst = next((reason for reason in reasons if reason.level is Level.UNUSABLE), None)
        if worst is None:
            raise
        raise InputError(f"{worst.message}: {worst.advice} ({error})") from error
