"""No option is declared in vain: the product reads each one, where its class is known (`option_reads`)."""

import ast
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, fields

import pytest
from threadpoolctl import threadpool_info

from hrsi.hrsi_engine.foundation.options import inner_options_of, option_of
from hrsi.hrsi_engine.foundation.progress import silent
from hrsi.hrsi_engine.foundation.workers.threads import thread_count
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.interface.declare import Algorithm, Common, Context, Report
from hrsi.tests.option_reads import OptionReads


@pytest.fixture(scope="module")
def reads() -> OptionReads:
    return OptionReads()


def option_fields(options: type, way: tuple[tuple[type, str], ...] = ()) -> Iterator[tuple[str, tuple]]:
    """Yield the name of every option with the fields, each with its class, that lead to its value."""
    for part in fields(options):
        steps = (*way, (options, part.name))
        said, inner = option_of(part), inner_options_of(part)
        if inner is not None:
            yield from option_fields(inner, steps)
        elif said is not None:
            yield said.name or part.name.replace("_", "-"), steps


def unread_options(options: type, reads: OptionReads) -> dict[str, str]:
    """Return the options that nothing reads, each with a field that is not read."""
    unread: dict[str, str] = {}
    read: set[str] = set()
    for name, steps in option_fields(options):
        missing = [
            f"{cls.__name__}.{attribute}" for cls, attribute in steps
            if not any((base.__name__, attribute) in reads.reads for base in cls.__mro__)
        ]  # fmt: skip
        if missing:
            unread[name] = missing[0]
        else:
            read.add(name)
    return {name: where for name, where in unread.items() if name not in read}


@pytest.mark.parametrize("algorithm", REGISTRY.values(), ids=lambda algorithm: algorithm.name)
def test_every_option_is_read(algorithm: Algorithm, reads: OptionReads) -> None:
    unread = unread_options(algorithm.options, reads)
    unread.pop("threads", None)  # `Algorithm.execute` holds every run to it
    assert not unread, (
        f"{algorithm.name} declares options that nothing reads: {unread}. Read the field where its value has an "
        "effect, by a name whose annotation says its class, or take the option out"
    )


def run(options: Common, context: Context) -> Report:
    """Do the work of the next test's algorithm."""
    blas = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
    return {"ours": thread_count(), "blas": blas, "named": thread_count(5)}


def test_every_run_is_held_to_its_threads() -> None:
    assert all("threads" in algorithm.defaults() for algorithm in REGISTRY.values())
    counting = Algorithm("count", "Count", "Tests", "Counts threads", "Counts.", Common, __name__)
    context = Context(silent, lambda message: None)
    free = counting.execute({"threads": 0}, context)
    held = counting.execute({"threads": 1}, context)
    assert free["ours"] == os.cpu_count() and max(free["blas"]) >= 1
    assert held == {"ours": 1, "blas": [1] * len(free["blas"]), "named": 5}
    assert counting.execute({"threads": 0}, context) == free


def test_an_option_that_nothing_reads_is_found(reads: OptionReads) -> None:
    """The test of the test: a field that only its declaration has, though its name is read of other things."""
    options = REGISTRY["tie-points"].options

    @dataclass
    class Wider(options):
        path: str = field(default="", metadata=dict.fromkeys(["option"], option_of(fields(options)[0])))

    assert "path" in unread_options(Wider, reads)
    assert not any(name == "Wider" for name, _ in reads.reads)


def test_reads_follow_the_types_of_names(reads: OptionReads) -> None:
    source = ast.parse(
        "def f(options: SearchOptions, other: object):\n"
        "    workers, path = options.workers, other.path\n"
        "    return workers.scheduler_key\n"
    )
    before, reads.reads = reads.reads, set()
    reads._walk(source, {})
    after, reads.reads = reads.reads, before
    assert after - {("object", "path")} == {("SearchOptions", "workers"), ("WorkerOptions", "scheduler_key")}
