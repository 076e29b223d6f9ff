"""Fixtures for every test: where outside data lies, how hard hypothesis searches; and the list of heavy tests."""

import gc
import os
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

REPOSITORY = Path(__file__).resolve().parents[1]
TEST_DATA = Path(os.environ.get("HRSI_TEST_DATA") or REPOSITORY.parent / "shared" / "data")

# A shell has its background jobs ignore SIGINT, and so would every process that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Timing on a busy machine says nothing of the code, so there are no deadlines; the same examples every time.
settings.register_profile("default", deadline=None, derandomize=True, print_blob=True)
settings.register_profile("fuzz", deadline=None, max_examples=20_000, suppress_health_check=list(HealthCheck))
settings.register_profile("quick", settings.get_profile("default"), max_examples=40)  # for `make test`
settings.load_profile("default")

HEAVY_S = 3.0  # a test that takes more processor time is listed at the end


class ProcessorTimes:
    """Processor time of each test with its fixtures and the programs that it started and waited for."""

    def __init__(self) -> None:
        self.before, self.of_tests = self._spent(), Counter[str]()

    def _spent(self) -> float:
        return sum(os.times()[:4])

    def pytest_collection_finish(self) -> None:
        gc.freeze()  # the modules and thousands of tests stay: the collector need not look through them again and again
        gc.enable()
        self.before = self._spent()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Iterator[None]:
        report, spent = (yield), self._spent()
        report.processor_s, self.before = spent - self.before, spent
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.of_tests[report.nodeid] += getattr(report, "processor_s", 0.0)  # none where its process ended

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        heavy = [(name, seconds) for name, seconds in self.of_tests.most_common() if seconds > HEAVY_S]
        terminalreporter.section(f"processor time: {self.of_tests.total():.0f} s, tests above {HEAVY_S:g} s")
        for name, seconds in heavy:
            terminalreporter.line(f"{seconds:6.1f} s  {name}")


def pytest_configure(config: pytest.Config) -> None:
    gc.disable()  # until all tests are collected: a third of the processor time of that
    if "not (" in config.option.markexpr and not config.getoption("hypothesis_profile", None):
        settings.load_profile("quick")
    config.pluginmanager.register(ProcessorTimes())


def _data_folder(name: str) -> Path:
    """Return a folder of the test data; without it, skip, or fail where CI is true."""
    folder = TEST_DATA / name
    if folder.is_dir():
        return folder
    reason = f"test data {folder} is not there; HRSI_TEST_DATA names the folder that holds {name}/"
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def case_data() -> Path:
    """Return the folder of small cases that people reported."""
    return _data_folder("cases")


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the repository, which is the package ``hrsi``."""
    return REPOSITORY


@pytest.fixture(scope="session")
def product() -> Any:
    """The shipped sources (a `measure_structure.Product`), read and parsed once a process."""
    from measure_structure import Product  # beside pytest alone: benchmarks that import this module do not find scripts

    return Product(REPOSITORY)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Real satellite images and RPC files."""
    return _data_folder("real")


@pytest.fixture(scope="session")
def hobart() -> dict[str, Any]:
    """The files of the Hobart block, as options of `adjust` and others."""
    data = REPOSITORY / "examples" / "hobart"
    images = [str(data / f"hobart_ikonos_{number}_RPC.TXT") for number in (1, 2, 3)]
    points = {"gcps": "hobart_ground_points.csv", "image_points": "hobart_image_points.csv"}
    return {"images": images} | {key: str(data / name) for key, name in points.items()}


@pytest.fixture(scope="session")
def hobart_result(hobart: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of `triangulate` on the Hobart block with six GCPs: no pixels, no tie points."""
    from hrsi.processing_algorithms import run

    folder = tmp_path_factory.mktemp("hobart") / "out"
    chosen = "H003,H022,H024,H035,H048,H058"
    run("triangulate", **hobart, tie_points="none", gcp_ids=chosen, output_dir=str(folder))
    return folder


@pytest.fixture(scope="session")
def sound_inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Inputs of every algorithm (`every_algorithm.make_scene`), once a process; copy them to write there."""
    from every_algorithm import make_scene

    folder = tmp_path_factory.mktemp("sound") / "scene"
    make_scene(folder)
    return folder


@pytest.fixture(scope="session")
def thesis_data() -> Path:
    """Tables printed in the thesis."""
    return _data_folder("thesis")
