"""Kept work that a failing disk damaged is made again, and the tables are those of a whole run."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile
from scipy.special import ndtr

from rotortrack_cli.main import main

_spec = importlib.util.spec_from_file_location("damage", Path(__file__).with_name("damage.py"))
damage = importlib.util.module_from_spec(_spec)
sys.modules["damage"] = damage
_spec.loader.exec_module(damage)

TABLES = ("localisations", "rotors", "tracks", "decisions")


def film(path: Path, frames: int = 150) -> None:
    """Write a movie of one spot that runs round a circle."""
    rng = np.random.default_rng(4)
    angle = np.cumsum(rng.normal(0.3, 0.2, frames))
    x, y = 12 + 0.5 * np.cos(angle), 10 + 0.5 * np.sin(angle)
    gx = np.diff(ndtr((np.arange(25) - x[:, None]) / 1.3), axis=1)
    gy = np.diff(ndtr((np.arange(21) - y[:, None]) / 1.3), axis=1)
    photons = rng.poisson(4000 * gy[:, :, None] * gx[:, None, :] + 5)
    tifffile.imwrite(path, (photons * 2 + 100).astype(np.uint16), photometric="minisblack")


def words(folder: Path) -> list[str]:
    scale = ("--pixel-size-nm", "100", "--frame-interval-s", "0.002", "--exposure-s", "0.002")
    camera = ("--offset-adu", "100", "--gain-e-per-adu", "0.5", "--read-noise-e", "1.5")
    rest = ("--no-figures", "--workers", "1", "-q", "-o", str(folder / "run"))
    return ["run", str(folder / "film.tif"), *scale, *camera, *rest]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Make a run, and stop it, as it were, before its tables were written."""
    folder = tmp_path_factory.mktemp("resume")
    film(folder / "film.tif")
    assert main(words(folder)) == 0
    shutil.copytree(folder / "run", folder / "undisturbed")
    return folder


def tables(run: Path) -> dict[str, pd.DataFrame]:
    return {name: pd.read_parquet(run / f"{name}.parquet") for name in TABLES}


def resumed(folder: Path, name: str, content: bytes) -> tuple[int, dict[str, pd.DataFrame]]:
    """Damage one file of the kept work of a run without results, and give the command again."""
    run = folder / "run"
    shutil.rmtree(run)
    (run / "parts").mkdir(parents=True)
    shutil.copytree(folder / "undisturbed" / "parts", run / "parts", dirs_exist_ok=True)
    manifest = json.loads((folder / "undisturbed" / "run.json").read_text())
    (run / "run.json").write_text(json.dumps({**manifest, "state": "unfinished", "tables": []}))
    (run / name).write_bytes(content)
    code = main(words(folder))
    return code, tables(run) if code == 0 else {}


def parts(folder: Path, ending: str) -> list[str]:
    run = folder / "undisturbed"
    return sorted(str(path.relative_to(run)) for path in (run / "parts").rglob(f"*{ending}"))


def test_whole_parts_are_taken_and_lost_ones_made_again(
    whole: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    expected = tables(whole / "undisturbed")
    assert len(expected["localisations"]) > 100
    (first, *_) = parts(whole, ".parquet")
    for content in ((whole / "undisturbed" / first).read_bytes(), b"", b"PAR1"):
        code, found = resumed(whole, first, content)
        assert code == 0, capfd.readouterr().err
        for name in TABLES:
            pd.testing.assert_frame_equal(found[name], expected[name], check_exact=True)


@pytest.mark.slow
def test_damaged_parts_are_made_again(whole: Path, capfd: pytest.CaptureFixture[str]) -> None:
    expected = tables(whole / "undisturbed")
    names = [*parts(whole, ".parquet"), *parts(whole, ".json")]
    assert len(names) > 6
    ends: Counter[str] = Counter()
    faults = []
    for number in range(120):
        rng = np.random.default_rng([number, 21])
        name = names[number % len(names)]
        content = (whole / "undisturbed" / name).read_bytes()
        way, changed = damage.damage(name, content, rng)
        code, found = resumed(whole, name, changed)
        shown = capfd.readouterr().err
        ends[f"exit {code}"] += 1
        if code not in (0, 3, 7) or "Traceback" in shown:
            faults.append((number, name, way, shown))
        elif code == 0 and not all(found[table].equals(expected[table]) for table in TABLES):
            faults.append((number, name, way, "other tables"))
    assert not faults, "\n".join(map(str, faults))
    assert ends["exit 0"] > 100, ends
