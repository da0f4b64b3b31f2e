import pytest

from swarmsim.core.durations import seconds_of, told


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("20min", 1200),
        ("8 min", 480),
        ("90s", 90),
        ("1.5h", 5400),
        (300, 300),
        ("300", 300),
        (" .5 s ", 0.5),
        (2.5, 2.5),
    ],
)
def test_durations_are_read(text: str | float, seconds: float) -> None:
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "min", "8 m", "-5s", "0", 0, -1.0, "1e3s", "8min 30s", float("nan"), "inf", True])
def test_others_are_refused_with_what_is_expected(text: str | float) -> None:
    with pytest.raises(ValueError, match=r"is no duration; expected a time above 0, such as \"8min\""):
        seconds_of(text)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(480, "8 min"), (45, "45 s"), (4800, "1 h 20 min"), (3661, "1 h 1 min 1 s"), (0.5, "0.5 s"), (2, "2 s"),
     (59.6, "1 min"), (9.96, "10 s"), (3600, "1 h"), (0, "0 s")],
)  # fmt: skip
def test_durations_are_told(seconds: float, words: str) -> None:
    assert told(seconds) == words
