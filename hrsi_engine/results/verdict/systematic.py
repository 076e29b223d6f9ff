"""What a field left in the residuals of an image means: a note where it does no harm, a reason where it does."""

from __future__ import annotations

from collections.abc import Iterator

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from .evidence import Evidence

LARGE_FIELD_PX = 4.0  # RMS of a field that bends orthoimages visibly
SEEN_FIELD_PX = 0.05  # what is worth a note


def describe_residual_fields(evidence: Evidence) -> list[str]:
    """Tell of fields that are real and do no harm yet."""
    fields = [field for field in evidence.fields if SEEN_FIELD_PX <= field.rms_px < LARGE_FIELD_PX]
    if not fields:
        return []
    worst = fields[0]
    return [
        f"the residuals of image {list_ids(field.image for field in fields)} are not random: up to {worst.rms_px:.2g} "
        f"px ({worst.image}) follow a polynomial of the position; the model {worst.model} would remove it"
    ]


def find_large_fields(evidence: Evidence) -> Iterator[Reason]:
    """Fields large enough to bend what is made with the RPCs."""
    fields = [field for field in evidence.fields if field.rms_px >= LARGE_FIELD_PX]
    if fields:
        worst = fields[0]
        yield Reason(
            "systematic-residuals", Level.DOUBTFUL,
            f"the residuals of image {list_ids(field.image for field in fields)} have a systematic field: "
            f"{worst.rms_px:.2g} px of {worst.all_px:.2g} px in {worst.image} follow a polynomial of the position",
            "look for wrong points: the model would follow this field if they let it"
            if worst.model == evidence.result.model.name
            else f"choose the model {worst.model}, which removes it; look for wrong points if it does not",
            images=tuple(field.image for field in fields),
        )  # fmt: skip


ON_FIELDS = (find_large_fields,)
