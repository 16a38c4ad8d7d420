"""Settings of random tests; files to be read; studies with the real FE model, run once."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cheaper_text import in_place_of
from hypothesis import settings
from threadpoolctl import threadpool_limits

if TYPE_CHECKING:
    from calib.study.stages import StudyResult

# The same examples everywhere, and no limit on the time of one: machines differ.
settings.register_profile("softcal", deadline=None, derandomize=True)
settings.load_profile("softcal")

# `make` sets it, too: parts of a study that a test runs by themselves are of one thread as a whole.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
threadpool_limits(limits=1)  # where a plugin of pytest has loaded NumPy before


@pytest.fixture(scope="session")
def finished_studies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of finished studies: SOFTCAL_RUNS if it is set, so that their FE runs are reused."""
    given = os.environ.get("SOFTCAL_RUNS")
    return Path(given) if given else tmp_path_factory.mktemp("runs")


CHEAPER = {
    "sampling = [12, 4, 2]": "sampling = [8, 3, 2]",
    "check = [18, 6, 4]": "check = [12, 5, 2]",
    "sampling = [12, 6, 2]": "sampling = [8, 3, 2]",
    "check = [20, 14, 5]": "check = [12, 5, 2]",
    "n_runs = 20": "n_runs = 16",
    "n_refine = 8": "n_refine = 6",
}
"""meshes and numbers of runs of the study, and those of its test"""


@pytest.fixture(scope="session")
def thesis_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The embedded study thesis-forces; cheaper, as above, unless SOFTCAL_RUNS is set."""
    text = (resources.files("calib.study") / "embedded" / "thesis-forces.toml").read_text()
    if "SOFTCAL_RUNS" not in os.environ:
        text = in_place_of(text, CHEAPER)
    path = tmp_path_factory.mktemp("study") / "thesis-forces.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="session")
def thesis_study(finished_studies: Path, thesis_file: Path) -> StudyResult:
    """That study, finished."""
    from calib.study.config import load_study
    from calib.study.stages import run_study

    out = finished_studies / "thesis-forces"
    return run_study(load_study(str(thesis_file)), out, show_progress=False)


@pytest.fixture
def put(tmp_path):
    """Writes content to a file of this test and gives its path."""

    def write(content: bytes | str, name: str = "file.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write
