"""No option is declared in vain: the product reads each one, where its class is known (`option_reads`)."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field, fields

import pytest

from hrsi.hrsi_engine.foundation.options import inner_options_of, option_of
from hrsi.processing_algorithms import REGISTRY
from hrsi.processing_algorithms.interface.declare import Algorithm
from hrsi.tests.option_reads import OptionReads

#: Every algorithm has `threads`, as the interface promises; these do all their work on one.
ON_ONE_THREAD = {
    "refine-rpc", "rpc-info", "project", "localize", "fit-rpc", "write-rpc", "measure-targets", "register",
}  # fmt: skip


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
    if algorithm.name in ON_ONE_THREAD:
        assert unread.pop("threads", None), f"{algorithm.name} reads `threads` now: take it out of ON_ONE_THREAD"
    assert not unread, (
        f"{algorithm.name} declares options that nothing reads: {unread}. Read the field where its value has an "
        "effect, by a name whose annotation says its class, or take the option out"
    )


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
