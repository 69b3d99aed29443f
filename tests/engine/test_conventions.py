"""Numbers as a person is told them."""

from __future__ import annotations

import math

import pytest

from seeing_wind.engine.conventions import SCALES, as_in_file, frame_named, frames_named, in_figures, in_units, weight_in_words


@pytest.mark.parametrize(
    ("value", "figures", "said"),
    [
        (0.0, 3, "0"), (6349.6, 3, "6350"), (0.999996, 3, "1"), (1234567.0, 3, "1,230,000"), (20.04, 3, "20"), (-0.01234, 2, "-0.012"),
        (99999.0, 5, "99999"), (0.05, 1, "0.05"), (1e300, 3, "1e+300"), (math.inf, 3, "inf"), (1e-12, 3, "1e-12"),
    ],
)  # fmt: skip
def test_a_number_has_no_power_of_ten_where_a_person_would_write_none(value: float, figures: int, said: str) -> None:
    assert in_figures(value, figures) == said


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [
        (0.00112, "kg", "1.12 g"), (0.9996, "kg", "1 kg"), (75.0, "kg", "75 kg"), (0.112, "kg/m²", "112 g/m²"), (1.2, "kg/m²", "1.2 kg/m²"),
        (2e7, "Pa", "20 MPa"), (8.9e4, "Pa", "89 kPa"), (0.00028, "m", "0.28 mm"), (0.21, "m", "210 mm"), (2e7, "m", "20000 km"),
        (1.2e-5, "m³", "12 cm³"), (8e-6, "N m", "8 µN m"), (-0.002, "m", "-2 mm"), (0.0, "kg", "0 kg"), (math.nan, "Pa", "nan Pa"),
        (4100.0, "N/m³", "4100 N/m³"), (12.5, "pixels", "12.5 pixels"),
    ],
)  # fmt: skip
def test_a_quantity_is_told_in_the_unit_of_its_size(value: float, unit: str, said: str) -> None:
    assert in_units(value, unit) == said


@pytest.mark.parametrize("unit", SCALES)
def test_what_is_told_is_the_value(unit: str) -> None:
    scales = {word: scale for scale, word in SCALES[unit]}
    for exponent in range(-8, 14):
        number, word = in_units(1.234 * 10.0**exponent, unit, 4).split(" ", 1)
        assert float(number.replace(",", "")) * scales[word] == pytest.approx(1.234 * 10.0**exponent)


def test_a_leaf_and_a_carpet_are_weighed() -> None:
    assert weight_in_words(0.112, 0.01) == "112 g/m², 1.12 g" and weight_in_words(2.4, 6.0) == "2.4 kg/m², 14.4 kg"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"It is first seen in {frame_named(4)}.", "It is first seen in frame 14 of the file."),
        (f"From {frame_named(7)} on, or {frames_named(3, 5)}: a guess.",
         "From frame 17 of the file on, or from frame 13 to 15 of the file: a guess."),
        ("Frames are missing between frame 0004.png and frame 6.png in /clips/frame 3/left.", ""), ("Give --outline-frame 4.", ""),
    ],
)  # fmt: skip
def test_frames_of_a_clip_are_counted_as_in_its_file(text: str, said: str) -> None:
    assert as_in_file(text, 10) == (said or text)
    assert as_in_file(as_in_file(text, 10), 10) == (said or text), "once is enough"
