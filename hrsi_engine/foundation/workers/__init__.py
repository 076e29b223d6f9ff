"""Execution of independent parts of a computation by threads of this machine and Dask workers of others."""
