"""Render a large simulated stereo pair and print time and peak memory.

    python benchmarks/simulate_large.py [--size 12000] [--sensor pleiades] [--threads 0] [--folder DIR]

Issue: a 12 000 x 12 000 pair within 1 GiB of memory. Peak memory is the process's maximum resident set, which
includes Python, NumPy and GDAL themselves. Images are written to a temporary folder and removed.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time

from hrsi.processing_algorithms import run


def main() -> None:
    """Run `hrsi simulate` at full size and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=12000)
    parser.add_argument("--sensor", default="pleiades")
    parser.add_argument("--cliffs", type=float, default=0.0)
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--folder", default=None)
    given = parser.parse_args()
    threads = given.threads or os.cpu_count() or 1
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        start = time.monotonic()
        report = run(
            "simulate", output_dir=folder, sensor=given.sensor, images=2, size=given.size, cliffs=given.cliffs,
            threads=threads,
        )  # fmt: skip
        seconds = time.monotonic() - start
    megapixels = 2e-6 * given.size**2
    usage = resource.getrusage(resource.RUSAGE_SELF)
    cpu_seconds, peak_mib = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0
    fit = max(image["rpc_fit_max_px"] for image in report["images"].values())
    print(f"{given.sensor}, 2 x {given.size} x {given.size} px, {threads} threads")
    print(f"time          {seconds:8.1f} s")
    print(f"throughput    {megapixels / seconds:8.2f} Mpx/s, {megapixels / cpu_seconds:.2f} Mpx a second of one core")
    print(f"peak memory   {peak_mib:8.0f} MiB ({'within' if peak_mib <= 1024.0 else 'ABOVE'} 1 GiB)")
    print(f"RPC fit       {fit:8.1e} px")


if __name__ == "__main__":
    main()
