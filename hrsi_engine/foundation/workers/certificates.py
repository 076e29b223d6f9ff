"""Certificates for a Dask scheduler with encrypted connections."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Certificates:
    """PEM files for a scheduler with encrypted connections; values for None are taken from Dask's own configuration.

    authority : certificates of the authority that signed the certificate of the scheduler
    own : the certificate of this client; key : its private key, if it is not in the same file
    """

    authority: str | None = None
    own: str | None = None
    key: str | None = None


#: No files: the configuration of Dask is used.
CONFIGURED = Certificates()
