"""Orthoimages by Dask workers against threads, ``ortho_workers.py [--images 12] [--size 1500] [--workers 2]``.

A simulated block becomes orthoimages by the threads of one process and by the workers of a `LocalCluster`, on which one
worker is killed on the way: the files must be the same to the byte. Printed are CPU and wall seconds of both (the
workers' CPU included), and what travelled.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import signal
import tempfile
import time
from pathlib import Path
from typing import Any

import distributed

from hrsi.processing_algorithms import run


def cpu_of_workers(client: Any) -> float:
    return sum(sum(times[:2]) for times in client.run(os.times).values())


def digests(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*_ortho.tif"))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=12)
    parser.add_argument("--size", type=int, default=1500)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        scene = Path(name) / "scene"
        along = [str(angle) for angle in range(-given.images, given.images, 2)]
        run("simulate", images=given.images, size=given.size, along=along, relief=100.0, gcps=5, ties=0, checks=0,
            output_dir=str(scene))  # fmt: skip
        images = [str(scene / f"image_{number}.tif") for number in range(1, given.images + 1)]

        def make(out: str, **options: Any) -> tuple[float, float]:
            cpu, wall = time.process_time(), time.monotonic()
            run("orthorectify", images=images, dem=str(scene / "dem.tif"), output_dir=str(Path(name) / out), **options)
            return time.process_time() - cpu, time.monotonic() - wall

        cpu, wall = make("threads", threads=given.workers)
        print(f"threads: {cpu:.1f} CPU s, {wall:.1f} s")
        with distributed.LocalCluster(n_workers=given.workers, threads_per_worker=1, dashboard_address=":0") as cluster:
            with distributed.Client(cluster) as client:
                before = cpu_of_workers(client)
                cpu, wall = make("workers", scheduler=cluster.scheduler_address, threads=given.workers)
                there = cpu_of_workers(client) - before
                print(f"workers: {cpu:.1f} CPU s here, {there:.1f} there, {wall:.1f} s")
                victims = list(client.run(os.getpid).values())[:1]

            def kill(fraction: float, _message: str) -> bool:
                if fraction > 0.3 and victims:
                    os.kill(victims.pop(), signal.SIGKILL)
                return True

            make("killed", scheduler=cluster.scheduler_address, progress=kill)
        threads, *others = (digests(Path(name) / out) for out in ("threads", "workers", "killed"))
        assert len(threads) == given.images
        size = sum(file.stat().st_size for file in (Path(name) / "threads").glob("*.tif"))
        print(f"{len(threads)} orthoimages, {size / 1e6:.0f} MB")
        print("same bytes by workers:", others[0] == threads, "- with one killed:", others[1] == threads)


if __name__ == "__main__":
    main()
