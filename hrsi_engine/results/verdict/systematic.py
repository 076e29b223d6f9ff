"""Notes and reasons for systematic residuals: a note for small ones, a reason for those with visible effects."""

from collections.abc import Iterator

from ...foundation.errors import list_ids
from ...foundation.reasons import Level, Reason
from .evidence import Evidence
from .fields import FIELD


def describe_residual_fields(evidence: Evidence) -> list[str]:
    """Return notes of significant fields that are too small for a reason."""
    fields = [field for field in evidence.fields if FIELD.noted_px <= field.rms_px < FIELD.large_px]
    if not fields:
        return []
    worst = fields[0]
    if evidence.is_followed(worst):
        remedy = (
            f"the model {evidence.result.model.name} has these terms, but their a priori standard deviations "
            "are too small for it"
        )
    else:
        remedy = f"the model {worst.model} would remove it"
    return [
        f"the residuals of image {list_ids(field.image for field in fields)} are systematic: up to "
        f"{worst.rms_px:.2g} px RMS ({worst.image}) are a polynomial of the position; {remedy}"
    ]


def find_large_fields(evidence: Evidence) -> Iterator[Reason]:
    """Yield the reason for fields that distort orthoimages visibly."""
    fields = [field for field in evidence.fields if field.rms_px >= FIELD.large_px]
    if fields:
        worst = fields[0]
        yield Reason(
            "systematic-residuals", Level.DOUBTFUL,
            f"the residuals of image {list_ids(field.image for field in fields)} have a systematic field: "
            f"{worst.rms_px:.2g} px of {worst.all_px:.2g} px RMS in {worst.image} are a polynomial of the position",
            "look for wrong points: the model includes this field"
            if evidence.is_followed(worst)
            else f"choose the model {worst.model}, which removes it; look for wrong points if it does not",
            images=tuple(field.image for field in fields),
        )  # fmt: skip


ON_FIELDS = (find_large_fields,)
