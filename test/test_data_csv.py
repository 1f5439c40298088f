# SPDX-License-Identifier: Apache-2.0
"""CSV files: there and back, and one broken file per way to break one."""

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.state import CHANNELS
from inductrack_ros.data import read_csv, write_csv, write_prediction

same_folder = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def csv(tmp_path, content):
    file = tmp_path / "run.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


# ---------------------------------------------------------------- what is read


def test_columns_come_in_canonical_order_and_time_starts_at_zero(tmp_path):
    run = read_csv(csv(tmp_path, "heave,time,surge\n1,10.5,2\n3,10.75,4\n"))
    assert run.name == "run"
    assert run.channels == ("surge", "heave")
    assert run.times.tolist() == [0, 0.25]
    assert run.stamps.tolist() == [10.5, 10.75]
    assert run.values.tolist() == [[2, 1], [4, 3]]
    assert run["heave"].tolist() == [1, 3]
    assert run.duration == 0.25


def test_a_missing_channel_is_a_key_error(tmp_path):
    with pytest.raises(KeyError):
        read_csv(csv(tmp_path, "time,heave\n0,1\n1,2\n"))["surge"]


@pytest.mark.parametrize("empty", ["", "  ", "nan", '""'])
def test_an_empty_cell_is_not_measured(tmp_path, empty):
    run = read_csv(csv(tmp_path, f"time,surge,heave\n0,{empty},1\n1,2,{empty}\n2,3,4\n"))
    assert run.measured.tolist() == [[False, True], [True, False], [True, True]]
    times, values = run.samples("surge")
    assert times.tolist() == [1, 2]
    assert values.tolist() == [2, 3]


def test_a_row_may_hold_nothing_but_its_time(tmp_path):
    run = read_csv(csv(tmp_path, "time,surge,heave\n0,1,1\n1,,\n2,3,4\n"))
    assert run.times.tolist() == [0, 1, 2]
    assert not run.measured[1].any()


@pytest.mark.parametrize(
    "text",
    [
        "time,heave\r\n0,1\r\n1,2\r\n",  # Windows
        "\ufefftime,heave\n0,1\n1,2",  # byte order mark, no last line end
        '"time", heave \n "0" ,1\n\n1, 2 \n\n',  # quotes, spaces, blank lines
        "time,heave\r0,1\r1,2\r",
    ],
)
def test_the_dialects_of_spreadsheets(tmp_path, text):
    run = read_csv(csv(tmp_path, text.encode()))
    assert run.times.tolist() == [0, 1]
    assert run["heave"].tolist() == [1, 2]


# ---------------------------------------------------------------- there and back


@same_folder
@given(
    values=arrays(float, (4, len(CHANNELS)), elements=st.floats(allow_infinity=False, allow_nan=False)),
    holes=arrays(bool, (3, len(CHANNELS))),
)
def test_what_is_written_is_read_to_the_last_bit(tmp_path, values, holes):
    values[:3][holes] = np.nan  # the last row stays, so that no channel is empty
    times = np.array([0.0, 0.1, 0.30000000000000004, 1e9])
    file = tmp_path / "out.csv"
    write_csv(file, times, dict(zip(CHANNELS, values.T, strict=True)), overwrite=True)
    run = read_csv(file)
    assert run.channels == CHANNELS
    assert np.array_equal(run.stamps, times)
    assert np.array_equal(run.values, values, equal_nan=True)


def test_a_prediction_has_the_stamps_and_channels_of_the_run(tmp_path):
    measured = csv(tmp_path, "time,heave,sway\n10.1,1,\n10.2,3,4\n")
    run = read_csv(measured)
    file = write_prediction(tmp_path, run, np.array([[0.5, 0.25], [1.5, 2.5]]))
    assert file.name == "run.predicted.csv"
    assert file.read_text() == "time,sway,heave\n10.1,0.5,0.25\n10.2,1.5,2.5\n"
    write_prediction(tmp_path, run, np.zeros((2, 2)))
    assert read_csv(file)["heave"].tolist() == [0, 0]


def test_whole_nanoseconds_are_written_as_exact_seconds(tmp_path):
    file = tmp_path / "out.csv"
    write_csv(file, np.array([1760000000000200001, 1760000000002000000]), {"heave": [1, 2]})
    assert file.read_text().splitlines()[1:] == ["1760000000.000200001,1.0", "1760000000.002000000,2.0"]


def test_an_existing_file_is_kept_and_nothing_is_left_behind(tmp_path):
    file = csv(tmp_path, "precious")
    with pytest.raises(InputError, match="exists already"):
        write_csv(file, [0, 1], {"heave": [1, 2]})
    assert file.read_text() == "precious"
    with pytest.raises(InputError, match="no folder"):
        write_csv(tmp_path / "none" / "run.csv", [0, 1], {"heave": [1, 2]})
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_csv(tmp_path / "folder", [0, 1], {"heave": [1, 2]}, overwrite=True)
    assert sorted(os.listdir(tmp_path)) == ["folder", "run.csv"]


# ---------------------------------------------------------------- one broken file per failure

BROKEN = {
    "empty": ("", "empty"),
    "blank": ("\n \n", "empty"),
    "no header": ("0,1\n1,2\n", "row 1.*no header"),
    "header only": ("time,heave\n", "0 rows.*at least 2"),
    "one row": ("time,heave\n0,1\n", "1 row of data.*at least 2"),
    "typo": ("time,heeve\n0,1\n1,2\n", "row 1: unknown column 'heeve'; did you mean 'heave'"),
    "no time": ("surge,heave\n0,1\n1,2\n", "'time' is missing"),
    "only time": ("time\n0\n1\n", "no channel beside 'time'"),
    "twice": ("time,heave,heave\n0,1,1\n1,2,2\n", "two columns hold heave, 'heave' and 'heave'; keep one"),
    "text": ("time,heave\n0,1\n1,high\n2,3\n", "row 3, column 'heave': 'high' is not a number"),
    "text after blank lines": ("time,heave\n0,1\n\n\n1,high\n2,3\n", "row 5, column 'heave'"),
    "decimal comma": ("time,heave\n0,1\n1,2,5\n2,3\n", "row 3: 3 cells where the header names 2"),
    "unit in the cells": (
        "time,heave\n0.0 s,1\n0.1 s,1\n",
        "'0.0 s' is not a number; write the unit into the header, 'time .s.', and only numbers below",
    ),
    "exponent of Fortran": ("time,heave\n0,1\n1,1.0D-03\n", "'1.0D-03' is not a number; write its exponent with E"),
    "numbers for a header": ("0.0,1.0,track\n0.1,1.0,track\n", "row 1: holds numbers and no names; put a row above it"),
    "underscore": ("time,heave\n0,1\n1,1_000\n", "'1_000' has thousands separators"),
    "infinite": ("time,heave\n0,1\n1,inf\n", "row 3, column 'heave': infinite"),
    "too large": ("time,heave\n0,1\n1,1e999\n", "row 3, column 'heave': infinite"),
    "infinite time": ("time,heave\n0,1\ninf,2\n", "row 3, column 'time': infinite"),
    "no time in a row": ("time,heave\n0,1\n,2\n2,3\n", "row 3: no time"),
    "nan time": ("time,heave\n0,1\nnan,2\n2,3\n", "row 3: no time"),
    "backwards": ("time,heave\n0,1\n2,2\n1,3\n", "row 4 is stamped 1 s earlier than one before it; correct the times"),
    "repeated": ("time,heave\n0,1\n\n1,2\n1,3\n", "row 5 repeats the stamp of row 4 with other values"),
    "short row": ("time,surge,heave\n0,1,1\n1,2\n2,3,3\n", "row 3: 2 cells where the header names 3; complete"),
    "all rows short": ("time,surge,heave\n0,1\n1,2\n", "row 2: 2 cells"),
    "empty channel": ("time,surge\n0,\n1,\n", "every channel is empty from top to bottom"),
    "open quote": ('time,heave\n0,1\n1,"2\n2,3\n', "run.csv, row "),
    "huge cell": ("time,heave\n0,1\n1,x" + "1" * 200_000, "run.csv, row "),
    "nul": ("time,heave\n0,1\n1,\0\n", "row 3"),
}


@pytest.mark.parametrize(("content", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_file_is_one_line_that_names_it(tmp_path, content, message):
    file = csv(tmp_path, content)
    with pytest.raises(InputError, match=message) as caught:
        read_csv(file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(file))


def test_what_is_no_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_csv(tmp_path / "none.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_csv(tmp_path)
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="not a regular file"):
        read_csv(tmp_path / "pipe.csv")
    with pytest.raises(InputError):
        read_csv("a\0b.csv")
    with pytest.raises(InputError):
        read_csv("x" * 5000)
