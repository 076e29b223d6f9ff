"""The models ``auto`` and ``generic``: the model that a block's GCPs support, and what the report says of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.block.block import Block
from ...hrsi_engine.refinement.selection import RULES, Choice, choose_model


class Chosen(NamedTuple):
    """Options with the model's own name, entries for the report, and warnings."""

    options: AdjustOptions
    entries: dict[str, Any]
    warnings: list[str]


def choose_model_of_options(block: Block, options: AdjustOptions) -> Chosen:
    """Return the options with a rule replaced by the model that it chooses."""
    if options.model not in RULES:
        return Chosen(options, {}, [])
    choice = choose_model(block, options.model)
    suspects = [
        f"{suspect.image}: GCP {suspect.id} disagrees with the others by {suspect.deviation_px:.1f} px; the model was "
        "chosen without it"
        for suspect in choice.suspects
    ]
    return Chosen(
        replace(options, model=choice.model),
        {"model_choice": choice_entry(options.model, choice)},
        [*choice.warnings, *suspects],
    )


def choice_entry(rule: str, choice: Choice) -> dict[str, Any]:
    """Return what the report says of a choice."""
    return {
        "rule": rule,
        "model": choice.model,
        "reason": choice.reason,
        "prediction_rmse_px": dict(choice.scores),
        "suspects": [suspect._asdict() for suspect in choice.suspects],
    }
