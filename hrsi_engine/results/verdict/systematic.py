"""Notes on systematic residuals of images."""

from ...foundation.errors import list_ids
from .evidence import Evidence
from .fields import FIELD


def describe_residual_fields(evidence: Evidence) -> list[str]:
    """Return notes of significant fields in the residuals of images."""
    fields = [field for field in evidence.fields if field.rms_px >= FIELD.noted_px]
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
