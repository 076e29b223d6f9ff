"""Workers of a Dask scheduler that adjust a block, and the folder through which they get its parts."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager

from ...hrsi_engine.adjustment.subtrees.loop import Elsewhere, open_workers
from ...hrsi_engine.io.opening.virtual_files import VIRTUAL, remove_virtual
from ...hrsi_engine.io.safety.deposits import FileDeposit
from ...hrsi_engine.io.safety.leftovers import FOLDER_PREFIX, hidden_folder
from ..interface.option_groups import WorkerOptions


@contextmanager
def adjusting_workers(options: WorkerOptions, output_dir: str) -> Iterator[Elsewhere | None]:
    """Give the workers that the options name; None where they name none.

    Parts of the block lie in a hidden folder of the output directory meanwhile, so workers have to see that.
    """
    if not options.scheduler:
        yield None
        return
    if output_dir.startswith(VIRTUAL):
        parts = os.path.join(output_dir, f"{FOLDER_PREFIX}{secrets.token_hex(8)}")
        try:
            with open_workers(options.scheduler, options.certificates, FileDeposit(parts)) as elsewhere:
                yield elsewhere
        finally:
            remove_virtual(parts)
        return
    with (
        hidden_folder(os.path.abspath(output_dir)) as parts,
        open_workers(options.scheduler, options.certificates, FileDeposit(parts)) as elsewhere,
    ):
        yield elsewhere
