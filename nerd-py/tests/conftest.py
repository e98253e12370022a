"""What all tests share."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def root():
    """The project's folder, from which its models are found."""
    return ROOT


@pytest.fixture(scope="session")
def models():
    """Folder of the models that come with the project."""
    return ROOT / "models"


@pytest.fixture(autouse=True)
def at_home(monkeypatch):
    """Tests run in the project's folder, wherever they are started."""
    monkeypatch.chdir(ROOT)
    os.environ.pop("WORLD_SIZE", None)
