"""What every other room stands on: errors, progress, threads and workers, compiled loops, robust scale."""
