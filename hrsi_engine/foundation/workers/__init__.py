"""Threads of this machine and Dask workers of others: how independent pieces of work are carried out."""
