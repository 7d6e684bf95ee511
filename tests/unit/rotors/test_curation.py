"""Files of human verdicts: read, appended to, matched with rotors."""

from __future__ import annotations

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.rotors.curation import (
    HumanVerdict,
    append_verdicts,
    match_verdicts,
    read_curation,
)

GOOD = '[[rotor]]\nrotor = 3\nx_nm = 10.0\ny_nm = 20\nverdict = "kept"\n'
ROTORS = pd.DataFrame({"rotor": [0, 1, 2], "x_nm": [0.0, 900.0, 960.0], "y_nm": [0.0, 0.0, 0.0]})


def verdict(rotor=0, x_nm=0.0, y_nm=0.0, word="kept", **more):
    return HumanVerdict(rotor=rotor, x_nm=x_nm, y_nm=y_nm, verdict=word, **more)


def test_without_a_file_nobody_decided_anything(tmp_path):
    assert read_curation(tmp_path / "curation.toml") == []


def test_a_file_written_by_hand_is_read(tmp_path):
    path = tmp_path / "curation.toml"
    more = 'reason = "why not"\nby = "Ada"\nat = 2026-11-23\n# a remark\n'
    path.write_text("# mine\n" + GOOD + more)
    expected = verdict(3, 10.0, 20.0, reason="why not", by="Ada", at="2026-11-23")
    assert read_curation(path) == [expected]
    assert expected.remark == "why not (Ada, 2026-11-23)"
    assert (verdict(by="Ada").remark, verdict().remark) == ("Ada", "")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("rotor = 3", "stands outside any"),
        ("[rotor]\nrotor = 3", r"must be written \[\[rotor\]\]"),
        ("[[rotors]]\nrotor = 3", "rotors stands outside"),
        ("[cluster]\ndistance_nm = 3", "cluster is not known"),
        ('[[rotor]]\nrotor = 3\nverdict = "kept"', "x_nm, y_nm is missing"),
        (GOOD.replace("kept", "keep"), "verdict must be kept or refused, not 'keep'"),
        (GOOD.replace('"kept"', "[1]"), "verdict must be kept or refused"),
        (GOOD.replace("= 3", "= -3"), "rotor must be a number from 0"),
        (GOOD.replace("= 3", "= true"), "rotor must be a number from 0"),
        (GOOD.replace("10.0", "nan"), "x_nm must be a number of nm"),
        (GOOD.replace("10.0", "'ten'"), "x_nm must be a number of nm"),
        (GOOD + "reason = 5", "reason must be text"),
        (GOOD + "colour = 5", "colour is not known"),
        ("[[rotor", "is not valid TOML"),
    ],
)
def test_mistakes_are_told_in_a_sentence_that_names_the_file(tmp_path, text, sentence):
    path = tmp_path / "curation.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=sentence) as caught:
        read_curation(path)
    assert str(path) in str(caught.value)
    with pytest.raises(ConfigurationError, match=sentence):
        append_verdicts(path, [verdict()])
    assert path.read_text() == text


@pytest.mark.parametrize("end", ["", "\n", "\n\n", "\n# the last word"])
def test_appending_keeps_every_earlier_line(tmp_path, end):
    path = tmp_path / "curation.toml"
    before = "# mine\n" + GOOD.rstrip() + end
    path.write_text(before)
    append_verdicts(path, [verdict(7, word="refused")])
    append_verdicts(path, [verdict(8)])
    assert path.read_text().startswith(before)
    assert [said.rotor for said in read_curation(path)] == [3, 7, 8]


texts = st.text(max_size=60)


@given(reason=texts, by=texts, x_nm=st.floats(-1e9, 1e9))
def test_what_is_written_is_read_again(tmp_path_factory, reason, by, x_nm):
    path = tmp_path_factory.mktemp("curation") / "curation.toml"
    one = verdict(5, x_nm, -x_nm, "refused", reason=reason, by=by, at="2026")
    append_verdicts(path, [verdict(), one])
    assert read_curation(path) == [verdict(), one]


def test_what_was_written_in_one_line_cannot_be_appended_to(tmp_path):
    path = tmp_path / "curation.toml"
    text = 'rotor = [{rotor = 1, x_nm = 0, y_nm = 0, verdict = "kept"}]\n'
    path.write_text(text)
    assert len(read_curation(path)) == 1
    with pytest.raises(ConfigurationError, match="within one line"):
        append_verdicts(path, [verdict()])
    assert path.read_text() == text


def test_the_place_decides_and_the_number_only_between_neighbours():
    assert match_verdicts([verdict(7, 30.0, 40.0)], ROTORS).keys() == {0}
    assert match_verdicts([verdict(2, 930.0, 0.0)], ROTORS).keys() == {2}
    assert match_verdicts([verdict(1, 930.0, 0.0)], ROTORS).keys() == {1}


def test_the_last_word_counts():
    found = match_verdicts([verdict(0), verdict(0, word="refused"), verdict(0)], ROTORS)
    assert found == {0: verdict(0)}
    found = match_verdicts([verdict(0), verdict(9, 20.0, word="refused")], ROTORS)
    assert found[0].verdict == "refused"


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        (verdict(0, 300.0), r"rotor 0 at \(300, 0\) nm is no rotor .* nearest, 0, is 300 nm away"),
        (verdict(5, 930.0), "may be any of the rotors 1, 2"),
    ],
)
def test_a_verdict_that_fits_no_rotor_is_refused(said, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        match_verdicts([verdict(0), said], ROTORS)
    with pytest.raises(ConfigurationError, match="is no rotor of this run any more: correct"):
        match_verdicts([said], ROTORS.iloc[:0])
