"""The registry of per-localisation flags."""

from __future__ import annotations

from rotortrack.flags import FIT_FAILED, FitFlag


def test_every_flag_is_one_bit_with_a_sentence_of_its_own() -> None:
    flags = list(FitFlag)
    assert [flag.value for flag in flags] == [1 << i for i in range(len(flags))]
    sentences = {flag.sentence for flag in flags}
    assert len(sentences) == len(flags)
    assert all(sentence.endswith(".") for sentence in sentences)


def test_only_ends_of_a_fit_mean_that_it_failed() -> None:
    assert FIT_FAILED == (
        FitFlag.ITERATION_LIMIT | FitFlag.SINGULAR | FitFlag.LEFT_WINDOW | FitFlag.NOT_FINITE
    )
    assert int(FIT_FAILED) == 15


def test_flags_fit_the_integer_column_of_the_table() -> None:
    assert sum(FitFlag) < 2**31
