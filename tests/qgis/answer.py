"""What an algorithm does that only answers: it writes nothing."""

from hrsi.processing_algorithms.interface.declare import Context, Report


def run(options: object, context: Context) -> Report:
    """Return the answer."""
    return {"algorithm": "tiny-test", "answer": 42}


def summarise(report: Report) -> str:
    """Return the answer as text."""
    return str(report["answer"])
