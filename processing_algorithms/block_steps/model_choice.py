"""What the report says of a model that a rule, ``auto`` or ``generic``, has chosen."""

from typing import Any

from ...hrsi_engine.refinement.selection import ModelChoice


def choice_entries(rule: str, choice: ModelChoice | None) -> dict[str, Any]:
    """Return the report's entries about a choice; none where the model was named."""
    return {} if choice is None else {"model_choice": choice_entry(rule, choice)}


def choice_warnings(choice: ModelChoice | None) -> list[str]:
    """Return what is to be said of a choice: doubts about the GCPs, and those that had no say in it."""
    if choice is None:
        return []
    suspects = [
        f"{suspect.image}: GCP {suspect.id} disagrees with the others by {suspect.deviation_px:.1f} px; the model was "
        "chosen without it"
        for suspect in choice.suspects
    ]
    return [*choice.warnings, *suspects]


def choice_entry(rule: str, choice: ModelChoice) -> dict[str, Any]:
    """Return what the report says of a choice."""
    return {
        "rule": rule,
        "model": choice.model,
        "reason": choice.reason,
        "prediction_rmse_px": dict(choice.scores),
        "leave_one_out": {
            name: {"block_px": choice.delivered.get(name), "single_images_px": choice.scores.get(name)}
            for name in dict.fromkeys([*choice.delivered, *choice.scores])
        },
        "suspects": [suspect._asdict() for suspect in choice.suspects],
    }
