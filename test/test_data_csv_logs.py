# SPDX-License-Identifier: Apache-2.0
"""What loggers and spreadsheets put around and into a table, and how they count time."""

import re

import numpy as np
import pytest
from test_data_csv_dialects import PLAIN, read

from inductrack_ros.core.errors import InputError
from inductrack_ros.data import read_csv


@pytest.fixture
def plain(tmp_path):
    return read(tmp_path, PLAIN)


def test_a_group_above_the_header_is_no_unit(tmp_path, plain):
    """The letters of a group may be a unit's; a row of units holds nothing else."""
    run = read(tmp_path, "m,laser,laser\n" + PLAIN)
    assert np.array_equal(run.values, plain.values, equal_nan=True) and run.notes == (
        "1 row before the header left out",
    )


BEHIND = {
    "what a spreadsheet adds": (
        "Mean,0.9,-0.004\nStd.,0.1,0.0001\n",
        "2 rows behind the data left out: 'Mean', 'Std.'",
    ),
    "with colons, behind empty rows": (",,\nMin:,0.25,-0.005\nMax:,1.5,-0.003\n", "2 rows behind .*: 'Min:', 'Max:'"),
    "the end, in words": ("End of file\n", "1 row behind the data left out: 'End of file'"),
    "the end, in quotes": ('"*** END OF DATA ***"\n', "1 row behind"),
    "of a database": ("(3 rows affected)\n", "1 row behind"),
    "with points, behind cells without anything": (
        ",,\n,,\nAverage,0.9,-0.004\nStd. dev.,0.1,0.0001\nStandardabweichung,0.1,0.0001\n",
        "3 rows behind the data left out: 'Average', 'Std. dev.', 'Standardabweichung'",
    ),
    "a name alone": ("Average,,\n", "1 row behind the data left out: 'Average'"),
}


@pytest.mark.parametrize("kind", BEHIND)
def test_what_stands_behind_the_data_is_left_out_and_said(tmp_path, plain, kind):
    text, note = BEHIND[kind]
    run = read(tmp_path, PLAIN + text)
    assert np.array_equal(run.values, plain.values, equal_nan=True) and np.array_equal(run.times, plain.times)
    assert len(run.notes) == 1 and re.match(note, run.notes[0])


def test_a_summary_that_is_named_in_a_column_that_is_left_out(tmp_path, plain):
    """A last sample that bears such a name is later than the one before it, and a sample."""
    rows = PLAIN.splitlines()
    head, data = f"{rows[0]},mark", [f"{row}," for row in rows[1:]]
    behind = ["0.12,1.0,-0.004,Mean", "0.25,1.5,-0.003,Max of all"]
    run = read(tmp_path, "\n".join([head, *data, *behind, ""]))
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert run.notes == ("2 rows behind the data left out: 'Mean', 'Max of all'", "column left out: 'mark'")[::-1]
    run = read(tmp_path, "\n".join([head, *data[:-1], f"{data[-1]}end", ""]))
    assert len(run.times) == 3


@pytest.mark.parametrize(
    ("cell", "remedy"),
    [
        ("(0.004)", "write it as -0.004"),
        ("0.004-", "write it as -0.004"),
        ("34_415.6", "thousands separators; export the numbers without"),
    ],
)
def test_a_number_in_other_signs_says_how_it_is_written(tmp_path, cell, remedy):
    with pytest.raises(InputError, match=f"row 3, column 'heave': .*{remedy}"):
        read(tmp_path, PLAIN.replace("-0.004", cell))


def test_times_that_are_all_one_are_named(tmp_path):
    """As a spreadsheet shows milliseconds since 1970."""
    with pytest.raises(InputError, match="all have one and the same \\(too few digits"):
        read(tmp_path, "time [ms],heave\n1.76E+12,0.1\n1.76E+12,0.2\n1.76E+12,0.3\n")


def test_a_bad_time_in_the_last_row_is_no_summary(tmp_path):
    with pytest.raises(InputError, match="row 5, column 'time': 'abc' is not a number; correct it or delete the row"):
        read(tmp_path, PLAIN + "abc,0.1,-0.004\n")


@pytest.mark.parametrize(
    "word", ["OVER", "ol", "Overflow", "******", "No Data", "ERROR", "Invalid", "#WERT!", "#DIV/0!", "#¡VALOR!", "####"]
)
def test_cells_in_which_an_instrument_says_that_it_reads_nothing(tmp_path, plain, word):
    run = read(tmp_path, PLAIN.replace(",,", f",{word},"))
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert run.notes == (f"1 cell of 'surge' without a reading, as '{word}' in row 3",)


def test_such_words_in_a_column_that_is_left_out_say_nothing(tmp_path):
    run = read(tmp_path, "time,heave,state\n0,1,OVER\n1,2,ERROR\n")
    assert run.notes == ("column left out: 'state'",)


@pytest.mark.parametrize(("above", "below"), [(",", ";"), ("\t", " "), (";", "\t"), (",", " ")])
def test_rows_that_are_separated_otherwise_than_their_header(tmp_path, plain, above, below):
    head, _, rows = PLAIN.replace(",,", ",nan,").partition("\n")
    run = read(tmp_path, head.replace(",", above) + "\n" + rows.replace(",", below))
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert len(run.notes) == 1 and run.notes[0].startswith("the rows are separated by ")


def test_a_table_with_a_row_for_each_value_names_its_columns(tmp_path):
    """As databases export series: the names of channels stand among the data."""
    with pytest.raises(InputError, match="row 1: no channel beside 'time' .*'name'; 'value'"):
        read(tmp_path, "time,name,value\n0.0,surge,0.1\n0.0,heave,-0.005\n0.1,surge,0.2\n0.1,heave,-0.005\n")


def test_a_table_behind_two_heads_of_settings(tmp_path):
    """As LabVIEW writes it: the time stands under X_Value."""
    head = "Separator\tTab\nDate\t2026/11/29\nTime\t10:00:00.12\n***End_of_Header***\n\nChannels\t2\nSamples\t3\t3\n"
    head += "X_Dimension\tTime\tTime\nX0\t0.0E+0\t0.0E+0\nDelta_X\t0.004\t0.004\n***End_of_Header***\n"
    run = read(tmp_path, head + "X_Value\tsurge\theave\tComment\n0.0\t0.1\t-0.005\t\n0.004\t0.2\t-0.005\t\n")
    assert run.times.tolist() == [0.0, 0.004] and run["surge"].tolist() == [0.1, 0.2]
    assert run.numbers.tolist() == [13, 14]


def without_x(
    steps="0.004\t0.004", begins="0.5\t0.5", of="Time\tTime", rows="\t0.1\t-0.005\t\n\t0.2\t-0.005\n\t0.3\t-0.006\n"
):
    """A measurement file of LabVIEW that leaves the times out."""
    head = (
        "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\nTime\t10:00:00.12\n***End_of_Header***\n\nChannels\t2\n"
    )
    head += f"Samples\t3\t3\nX_Dimension\t{of}\n" + (f"X0\t{begins}\n" if begins else "")
    head += (f"Delta_X\t{steps}\n" if steps else "") + "***End_of_Header***\t\t\n"
    return head + "X_Value\tsurge\theave\tComment\n" + rows


def test_times_that_are_left_out_are_counted(tmp_path):
    """`X_Columns No`: X0 and Delta_X above the table say them."""
    run = read(tmp_path, without_x())
    assert run.stamps.tolist() == pytest.approx([0.5, 0.504, 0.508]) and run["surge"].tolist() == [0.1, 0.2, 0.3]
    assert run.seconds_stated
    assert "the rows have no times: counted from X0, 0.5 s, in steps of Delta_X, 0.004 s" in run.notes
    commas = without_x(rows="\t0,1\t-0,005\t\n\t0,2\t-0,005\n\t0,3\t-0,006\n", steps="0,004\t0,004", begins="")
    assert read(tmp_path, commas).times.tolist() == pytest.approx([0.0, 0.004, 0.008])
    lost = read(
        tmp_path, without_x(rows="\t0.1\t-0.005\t\n\t\t\t\n\t0.3\t-0.006\n")
    )  # nothing was measured in the second
    assert lost.times.tolist() == pytest.approx([0.0, 0.008])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (without_x(steps=""), r"row 13: the rows have no times, and no Delta_X above the table says .*X_Columns One"),
        (without_x(steps="0\t0"), "Delta_X above it is 0; fill them in, or save the file with one X column"),
        (without_x(steps="0.004\t0.002"), "Delta_X differs between the channels, 0.002 and 0.004; save"),
        (without_x(of="Frequency\tFrequency"), "its rows go on in Frequency, not in time"),
        ("time,surge,heave\n,0.1,-0.005\n,0.2,-0.005\n", "row 2: the rows have no times, and no Delta_X above"),
    ],
)
def test_times_that_are_nowhere_are_asked_for(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)


# ---------------------------------------------------------------- long times

EPOCH = 1_764_410_400_123_456_789
LONG = {
    "ns": ("time [ns]", lambda ns: f"{ns}"),
    "ns in the name": ("timestamp_ns", lambda ns: f"{ns}"),
    "s": ("time", lambda ns: f"{ns // 10**9}.{ns % 10**9:09d}"),
    "ms": ("time_ms", lambda ns: f"{ns // 10**6}.{ns % 10**6:06d}"),
}


@pytest.mark.parametrize("unit", LONG)
def test_times_since_1970_lose_no_nanosecond(tmp_path, unit):
    """A float resolves 0.2 µs of them."""
    name, write = LONG[unit]
    stamps = [EPOCH + 4_000_001 * i for i in range(5)]
    run = read(tmp_path, f"{name},heave\n" + "".join(f"{write(ns)},{i}\n" for i, ns in enumerate(stamps)))
    assert run.stamps.tolist() == stamps and np.array_equal(run.times, np.arange(5) * 4_000_001 / 1e9)
    assert run.seconds_stated == (unit != "s")
    commas = f"{name};heave\n" + "".join(f"{write(ns)};{i}\n".replace(".", ",") for i, ns in enumerate(stamps))
    assert read(tmp_path, commas).stamps.tolist() == stamps


@pytest.mark.parametrize(
    ("cell", "message"),
    [("", "row 4: no time"), ("x", "row 4, column 'time': 'x' is not a number"), ("inf", "row 4, .*infinite")],
)
def test_a_long_time_that_is_none_is_named(tmp_path, cell, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, f"time,heave\n1764410400.5,1\n1764410401.5,2\n{cell},3\n1764410402.5,4\n")


WRAPPED = {
    "16 bits of ms": ("time [ms]", 2**16, 4, 1e3),
    "32 bits of ms": ("time [ms]", 2**32, 4, 1e3),
    "32 bits of µs": ("time [us]", 2**32, 4000, 1e6),
    "32 bits of ns": ("time [ns]", 2**32, 4_000_000, 1e9),
}


@pytest.mark.parametrize("what", WRAPPED)
def test_a_counter_that_wraps_goes_on(tmp_path, what):
    name, period, step, second = WRAPPED[what]
    counts = [(period - 5 * step + step * i) % period for i in range(12)]
    run = read(tmp_path, f"{name},heave\n" + "".join(f"{c},{i}\n" for i, c in enumerate(counts)))
    assert run.times == pytest.approx(np.arange(12) * step / second, abs=1e-9)
    assert f"the times count {what} and begin again: {period / second:.10g} s added to the later ones" in run.notes


def test_a_clock_that_is_set_back_otherwise_does_not_wrap(tmp_path):
    times = [65.5, 65.504, 65.508, 0.5, 0.504, 0.508]
    with pytest.raises(InputError, match=r"row 5 is stamped 65\.008 s earlier"):
        read(tmp_path, "time,heave\n" + "".join(f"{t},{i}\n" for i, t in enumerate(times)))


def test_the_end_of_summer_time_is_named(tmp_path):
    """Local times without their zone go back by an hour."""
    times = ["02:59:59.992", "02:59:59.996", "02:00:00.000", "02:00:00.004"]
    with pytest.raises(InputError, match="row 4 .*; did summer time end\\? write the times in UTC or with their zone"):
        read(tmp_path, "time,heave\n" + "".join(f"2026-10-25 {t},{i}\n" for i, t in enumerate(times)))
    zones = [f"2026-10-25T{t}{zone}" for t, zone in zip(times, 2 * ["+02:00"] + 2 * ["+01:00"], strict=True)]
    run = read(tmp_path, "time,heave\n" + "".join(f"{t},{i}\n" for i, t in enumerate(zones)))
    assert run.times == pytest.approx([0, 0.004, 0.008, 0.012], abs=1e-12)


def test_samples_know_their_rows(tmp_path):
    """Also where rows are left out, repeated, out of order, or not in a file called CSV."""
    file = tmp_path / "run.txt"
    file.write_text("# made by hand\ntime;heave\n\n0;1\n# here\n0,2;3\n0,1;2\n0,1;2\n\n0,3;4\n")
    run = read_csv(file)
    assert run["heave"].tolist() == [1, 2, 3, 4] and run.numbers.tolist() == [4, 7, 6, 10]


def test_rows_that_begin_like_comments_are_said(tmp_path, plain):
    """A cell too narrow for its time is written as signs of numbers."""
    first, second, *rest = PLAIN.splitlines(keepends=True)
    run = read(tmp_path, "".join([first, second, "########,0.2,-0.004\n", "# all is well\n", *rest]))
    assert np.array_equal(run.times, plain.times)
    assert run.notes == ("1 row that begins like a comment, with as many cells as the others, left out",)


def test_numbers_that_a_spreadsheet_is_made_to_keep(tmp_path, plain):
    head, *rows = PLAIN.splitlines()
    kept = [",".join(f'="{cell}"' if cell else "" for cell in row.split(",")) for row in rows]
    assert np.array_equal(read(tmp_path, "\n".join([head, *kept]) + "\n").values, plain.values, equal_nan=True)


def test_blanks_around_commas_do_not_separate(tmp_path, plain):
    """Though by them alone more of the names are known."""
    head, *rows = PLAIN.splitlines()
    table = [f"{head.replace(',', ' , ')} , Surge Rate Raw , Roll Angle (deg)", *(f"{row},0.1,0.2" for row in rows)]
    run = read(tmp_path, "\n".join(table) + "\n")
    assert run.channels == plain.channels and np.array_equal(run.values, plain.values, equal_nan=True)


def test_a_time_in_two_columns_is_named(tmp_path):
    with pytest.raises(
        InputError, match="two columns: write 'header.stamp.sec' . 1e-9 . 'header.stamp.nanosec' as one"
    ):
        read(tmp_path, "header.stamp.sec,header.stamp.nanosec,surge\n1700000000,0,0.1\n1700000000,2000000,0.2\n")


def test_a_channel_that_is_read_as_an_input_is_said(tmp_path):
    (tmp_path / "run.csv").write_text(PLAIN)
    run = read_csv(tmp_path / "run.csv", inputs={"drive_current": "surge"})
    assert "surge" not in run.channels
    assert "column 'surge' is read as the input drive_current, not as the channel surge" in run.notes
