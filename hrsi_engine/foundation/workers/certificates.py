"""What a Dask scheduler that encrypts wants to see."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Certificates:
    """PEM files for a scheduler that encrypts; what is None comes from Dask's own configuration.

    authority : certificates of the authority that the scheduler's is signed by
    own : the certificate that this side shows; key : its private key, where that is not in the same file
    """

    authority: str | None = None
    own: str | None = None
    key: str | None = None


#: As Dask is configured.
CONFIGURED = Certificates()
