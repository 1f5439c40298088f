# SPDX-License-Identifier: Apache-2.0
"""CSV as loggers and spreadsheets write it: read to the same numbers, with a word about what was converted or left
out."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from inductrack_ros.core.errors import InputError
from inductrack_ros.data import read_csv, units

PLAIN = "time,surge,heave\n0,1.5,-0.005\n0.1,,-0.004\n0.25,2.5e-1,-0.003\n"


def read(tmp_path, content, **more):
    file = tmp_path / "run.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_csv(file, **more)


@pytest.fixture
def plain(tmp_path):
    return read(tmp_path, PLAIN)


SAME = {
    "semicolons": PLAIN.replace(",", ";"),
    "decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "decimal commas in quotes": (
        '"time","surge","heave"\n"0","1,5","-0,005"\n"0,1","","-0,004"\n"0,25","2,5e-1","-0,003"\n'
    ),
    "everything quoted": "\n".join(",".join(f'"{c}"' for c in line.split(",")) for line in PLAIN.splitlines()),
    "tabs": PLAIN.replace(",", "\t"),
    "tabs and decimal commas": PLAIN.replace(",", "\t").replace(".", ","),
    "bars": PLAIN.replace(",", "|"),
    "blanks": PLAIN.replace(",,", ",nan,").replace(",", "   "),
    "blanks before": "\n".join("  " + line for line in PLAIN.replace(",,", ",nan,").replace(",", " \t").splitlines()),
    "blanks and commas": PLAIN.replace(",", ", "),
    "sep=": "sep=,\n" + PLAIN,
    "sep=; quoted": '"sep=;"\r\n' + PLAIN.replace(",", ";").replace("\n", "\r\n"),
    "comments": "# Oscilloscope\n#Device: X, 1\n\n" + PLAIN + "# the end, or so\n",
    "comments of MATLAB": "% made by hand\n" + PLAIN,
    "comment within": PLAIN.replace("\n0.1", "\n# here\n0.1"),
    "header in a comment": "# " + PLAIN,  # numpy.savetxt
    "trailing separators": "\n".join(line + "," for line in PLAIN.splitlines()),
    "trailing separators but in the header": PLAIN.replace("5\n", "5,\n").replace("4\n", "4,\n").replace("3\n", "3,\n"),
    "empty rows of a spreadsheet": PLAIN + ",,\n,,\n",
    "byte-order mark": "\ufeff" + PLAIN,
    "old Macintosh": PLAIN.replace("\n", "\r"),
    "UTF-16": PLAIN.encode("utf-16"),
    "UTF-16, big end first": b"\xfe\xff" + PLAIN.encode("utf-16-be"),
    "UTF-16 without mark": PLAIN.encode("utf-16-le"),
    "UTF-16 without mark, big end first": PLAIN.encode("utf-16-be"),
    "UTF-16 without mark, other letters first": ("# Ωμέγα\n" + PLAIN).encode("utf-16-le"),
    "UTF-32": PLAIN.encode("utf-32"),
    "two byte-order marks": "\ufeff\ufeff" + PLAIN,
    "typeset, decimal commas": PLAIN.replace(",", ";").replace(".", ",").replace("-", "\u2212"),
    "typeset": PLAIN.replace("-0.005", "\u22120.005").replace("0.25,", "\u00a00.25,"),
    "Ctrl-Z": PLAIN + "\x1a",
    "camel case": PLAIN.replace("time", "relativeTime"),
    "no answer": PLAIN.replace(",,", ",n.a.,"),
    "header over two lines": PLAIN.replace("surge", '"surge\n[m]"'),
    "capitals": PLAIN.replace("time", "Time").replace("surge", "SURGE"),
    "no answer, in capitals": PLAIN.replace(",,", ",N.A.,"),
    "nothing": PLAIN.replace(",,", ",NONE,"),
    "a mark where two files were joined": PLAIN.replace("0.25,", "\ufeff0.25,"),
    "no number": PLAIN.replace(",,", ",NaN,"),
    "no number either": PLAIN.replace(",,", ",#N/A,"),
    "a dash": PLAIN.replace(",,", ",-,"),
    "no number, with a sign": PLAIN.replace(",,", ",+NaN,"),
    "no number, of another compiler": PLAIN.replace(",,", ",-nan(ind),"),
    "no time": PLAIN.replace(",,", ",NaT,"),
    "every row in quotes": "".join(f'"{line}"\n' for line in PLAIN.splitlines()),
    "every row in quotes, decimal commas": "".join(
        f'"{line}"\r\n' for line in PLAIN.replace(",", ";").replace(".", ",").splitlines()
    ),
    "a trailing separator in the header only": PLAIN.replace("heave\n", "heave,\n"),
    "a blank without width": PLAIN.replace("surge", "\u200bsurge"),
    "plus signs": PLAIN.replace("1.5", "+1.5"),
    "a line below the header": PLAIN.replace("heave\n", "heave\n----,-----,-----\n"),
    "columns under a line": "time surge heave\n---- ----- -----\n0 1.5 -0.005\n0.1 nan -0.004\n0.25 2.5e-1 -0.003\n",
    "UTF-16 with tabs and the line ends of DOS": PLAIN.replace(",", "\t").replace("\n", "\r\n").encode("utf-16"),
    "no number, of a compiler for Windows": PLAIN.replace(",,", ",-1.#IND00,"),
    "no number, of the same": PLAIN.replace(",,", ",1.#QNAN,"),
    "a column of blanks": PLAIN.replace("heave\n", "heave,  \n")
    .replace("5\n", "5, \n")
    .replace("4\n", "4, \n")
    .replace("3\n", "3, \n"),
}


@pytest.mark.parametrize("dialect", SAME)
def test_a_dialect_is_read_to_the_same_numbers(tmp_path, plain, dialect):
    run = read(tmp_path, SAME[dialect])
    assert run.channels == plain.channels and np.array_equal(run.values, plain.values, equal_nan=True)
    assert np.array_equal(run.times, plain.times) and run.notes == ()


CONVERTED = {
    "in brackets": "time [ms],surge [mm],heave [µm]\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "in parentheses": "Time (ms),Surge (mm),Heave (um)\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "behind a slash": "time/ms;surge/mm;heave/um\n0;1500;-5000\n100;;-4000\n250;250;-3000\n",
    "in the name": "time_ms,surge_mm,heave_um\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "in a row of its own": "time,surge,heave\nms,mm,µm\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "behind a colon": "time: ms,surge: mm,heave: um\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "in a row in brackets": "time,surge,heave\n[ms],[mm],[µm]\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "in a row above": "ms,mm,µm\ntime,surge,heave\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
    "in a row above, in brackets": "[ms];[mm];[µm]\ntime;surge;heave\n0;1500;-5000\n100;;-4000\n250;250;-3000\n",
    "in Windows-1252": "time [ms],surge [mm],heave [µm]\n0,1500,-5000\n100,,-4000\n250,250,-3000\n".encode("cp1252"),
}


@pytest.mark.parametrize("place", CONVERTED)
def test_units_are_converted_and_said(tmp_path, plain, place):
    run = read(tmp_path, CONVERTED[place])
    assert np.allclose(run.values, plain.values, rtol=1e-14, atol=0, equal_nan=True) and np.allclose(
        run.times, plain.times
    )
    assert run.notes[-1].startswith("converted to SI: time from ms, surge from mm, heave from ")
    assert run.seconds_stated


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("deg", "rad", math.pi / 180),
        ("°", "rad", math.pi / 180),
        ("degrees", "rad", math.pi / 180),
        ("mrad", "rad", 1e-3),
        ("km/h", "m/s", 1 / 3.6),
        ("mm/s", "m/s", 1e-3),
        ("mm_s", "m/s", 1e-3),
        ("m s^-1", "m/s", 1.0),
        ("m/min", "m/s", 1 / 60),
        ("deg/s", "rad/s", math.pi / 180),
        ("rpm", "rad/s", math.pi / 30),
        ("m/s2", "m/s²", 1.0),
        ("m/s^2", "m/s²", 1.0),
        ("mm/s²", "m/s²", 1e-3),
        ("m/s**2", "m/s²", 1.0),
        ("g", "m/s²", 9.80665),
        ("kA", "A", 1e3),
        ("m/s/s", "m/s²", 1.0),
        ("mph", "m/s", 0.44704),
        ("days", "s", 86400.0),
        ("Seconds", "s", 1.0),
        ("us", "s", 1e-6),
        ("μs", "s", 1e-6),
        ("MM", "m", 1e-3),
        ("s", "m", None),
        ("m/s", "m/s²", None),
        ("m/s²", "m/s", None),
        ("parsec", "m", None),
        ("mm", "rad", None),
    ],
)
def test_units(unit, si, factor):
    assert units.factor(unit, si) == (None if factor is None else pytest.approx(factor, rel=1e-12))


def test_an_abbreviated_unit_may_end_with_a_point(tmp_path):
    run = read(tmp_path, PLAIN.replace("time", "Time (msec.)"))
    assert run.times == pytest.approx([0.0, 1e-4, 2.5e-4]) and run.notes == ("converted to SI: time from msec",)


def test_a_unit_of_something_else_is_refused(tmp_path):
    with pytest.raises(
        InputError, match=r"row 1: column 'heave' is in 's', which is no unit known for it; convert it to m"
    ):
        read(tmp_path, "time,heave [s]\n0,1\n1,2\n")


def test_other_columns_are_left_out_with_a_word(tmp_path, plain):
    text = PLAIN.splitlines()
    run = read(
        tmp_path,
        "\n".join(f"{i},{line},{'temperature' if not i else 'warm'}" for i, line in enumerate(text)).replace(
            "0,time", ",time"
        ),
    )
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert run.notes == ("columns left out: the nameless one (1), 'temperature'",)
    empty = read(tmp_path, "time,surge,heave\n0,,1\n1,,2\n")
    assert empty.channels == ("heave",) and empty.notes == ("column 'surge' is empty from top to bottom and left out",)


def test_rows_before_the_header(tmp_path, plain):
    run = read(tmp_path, "My logger 3.1\nDate: 2026-01-01; 10:00\nchannels, 3\n\n" + PLAIN)
    assert np.array_equal(run.values, plain.values, equal_nan=True) and run.notes == (
        "3 rows before the header left out",
    )


def test_rows_before_and_below_the_header(tmp_path, plain):
    """A logger's forty lines of settings, what it calls its groups, and what each column is."""
    settings = "".join(f"setting {i}: on, off, {i}\n" for i in range(40))
    head, *rows = PLAIN.splitlines(keepends=True)
    run = read(tmp_path, settings + head + "clock,tracker,laser\ns,m,m\n" + "".join(rows))
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert run.notes == ("40 rows before the header left out", "1 row of words below the header left out")


ABOVE = {
    "a title with the same words": "Test of surge, heave, time\n",
    "a key that is called as the time": "time,2026-11-29 10:00\noperator,Kim\n",
    "the names twice": "time,surge\nTime,Surge,Heave\n",
    "many rows": "".join(f"setting {i},{i}\n" for i in range(250)),
    "channels with their number": "Channels,surge,heave\nRate,250\n",
    "the time twice, no channel": "X_Dimension\tTime\tTime\nSamples\t3\t3\n",
}


@pytest.mark.parametrize("kind", ABOVE)
def test_the_header_is_the_row_above_the_data_that_names_the_most(tmp_path, plain, kind):
    run = read(tmp_path, ABOVE[kind] + PLAIN)
    assert run.channels == plain.channels and np.array_equal(run.values, plain.values, equal_nan=True)
    rows = ABOVE[kind].count("\n")
    assert run.notes == (f"{rows} row{'' if rows == 1 else 's'} before the header left out",)


def test_a_header_with_units_goes_before_one_without(tmp_path):
    run = read(tmp_path, "time [ms],heave [mm]\ntime,heave\n0,1\n100,2\n")
    assert run.times.tolist() == [0, 0.1] and run["heave"].tolist() == [0.001, 0.002]


NOT_NAMED = {
    "other names": (
        "Model,X\n\nTIME,CH1,CH2\n0,1,2\n1,2,3\n",
        r"row 3: no channel beside 'time' \(there are 'TIME'; 'CH1'; 'CH2'\); name those that are channels so",
    ),
    "names in a comment": ("%time,field.x\n0,1\n1,2\n", "row 1: no channel beside 'time' .*'field.x'"),
    "one cell more in all rows": (
        "time,surge,heave\n1,0,1,2\n2,1,2,3\n",
        "row 2: 4 cells where the header names 3; as in all rows; name each column in the header",
    ),
    "one cell more in one": ("time,heave\n0,1\n1,2,3\n", "row 3: 3 cells where .* 2; complete the row or delete it"),
    "another table": ("time,heave\n0,1\n1,2\n\ntime,sway\n0,1\n", "row 5: another table begins; make a file of"),
    "no header": ("2026-01-01T10:00:00,1\n2026-01-01T10:00:01,2\n", "row 1: no header; a row above must name"),
}


@pytest.mark.parametrize("kind", NOT_NAMED)
def test_a_table_whose_columns_are_not_named(tmp_path, kind):
    text, message = NOT_NAMED[kind]
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)


def test_a_cell_over_several_lines_keeps_the_rows_numbers(tmp_path):
    text = 'time,surge,comment\n0,1,"start,\nof ""run""\n"\n1,2,\n2,3,5" pipe\n3,x,\n'
    with pytest.raises(InputError, match="row 6: a quote that is not closed"):
        read(tmp_path, text)
    with pytest.raises(InputError, match="row 7, column 'surge': 'x' is not a number"):
        read(tmp_path, text.replace('5"', "5"))
    assert read(tmp_path, text.replace('5"', "5").replace("x", "4"))["surge"].tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('time,surge\n0,"1,500"\n1,"1,600"\n', "row 2: '1,500' has a comma that is a decimal one or between thousands"),
        ('time,surge,heave\n0,"1,500",0.1\n', "row 2: '1,500' has a comma between thousands"),
        (
            "time [ms];surge\n0;1\n500;2\n1,000;3\n",
            "row 4: '1,000' has a comma that is a decimal one or between thousands",
        ),
        ("time;surge\n0.5;1,500.5\n", "row 2: '1,500.5' has a comma between thousands"),
        ("time;surge\n0,5;1.500,5\n1;2\n", "row 2, column 'surge': '1.500,5' has thousands separators"),
        ("time;surge\n0;1 500\n1;2\n", "row 2, column 'surge': '1 500' has thousands separators"),
        (
            "time;surge\n0;1,5\n1;2.5\n",
            "row 3, column 'surge': '2.5' is not a number with a decimal comma, as the others are",
        ),
    ],
)
def test_thousands_are_no_decimals(tmp_path, text, message):
    """Read as decimals they would be a thousandth."""
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)
    late = "time;surge\n" + "".join(f"{i};{i}\n" for i in range(4000)) + "4000;4000,5\n"
    assert read(tmp_path, late)["surge"][-1] == 4000.5


def test_what_a_cut_recording_reserved(tmp_path, plain):
    run = read(tmp_path, (PLAIN + "0.3,1").encode() + bytes(600))
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert run.notes == ("600 NUL characters at the end left out: the recording was cut off",)


@pytest.mark.parametrize("unit", ["UTC", "HH:MM:SS.fff", "local time", "yyyy-MM-dd hh:mm:ss"])
def test_a_form_of_dates_is_no_unit(tmp_path, unit):
    times = ["10:00:59.5", "10:01:00", "10:01:00.25"]
    run = read(tmp_path, f"Time ({unit}),heave\n" + "".join(f"{t},{i}\n" for i, t in enumerate(times)))
    assert run.times == pytest.approx([0, 0.5, 0.75])


def test_a_zone_that_is_not_read_is_said(tmp_path):
    with pytest.raises(InputError, match="row 2, column 'time': '2026-01-01 10:00:00 CET' is no time that is read"):
        read(tmp_path, "time,heave\n2026-01-01 10:00:00 CET,1\n2026-01-01 10:00:01 CET,2\n")


@pytest.mark.parametrize("header", ["heave_rat", "heave_raet", "heave_ratee", "heave_rste"])
def test_a_name_one_letter_off_is_refused(tmp_path, header):
    with pytest.raises(InputError, match=f"unknown column '{header}'; did you mean 'heave_rate'"):
        read(tmp_path, f"time,heave,{header}\n0,1,2\n1,2,3\n")
    assert read(tmp_path, "time,heave,heave_raw\n0,1,2\n1,2,3\n").notes == ("column left out: 'heave_raw'",)


def test_one_quantity_twice_names_both_columns(tmp_path):
    with pytest.raises(InputError, match="two columns hold time, 'stamp_sec' and 'stamp_nsec'; keep one"):
        read(tmp_path, "stamp_sec,stamp_nsec,heave\n17,0,1\n17,500000000,2\n")


def test_a_missing_time_names_what_is_there(tmp_path):
    with pytest.raises(InputError, match="name the column that holds it so \\(there are 'clock'; 'surge'\\)"):
        read(tmp_path, "clock,surge\n0,1\n1,2\n")


def test_rows_in_file_order_and_in_time(tmp_path):
    """Late rows are sorted; a clock that was set back is told from them, and rounded stamps from two runs in a file."""
    rows = [f"{0.01 * i:.4f},{0.16 * i:.4f}" for i in range(300)]
    table = lambda rows: read(tmp_path, "time,surge\n" + "\n".join(rows))  # noqa: E731
    assert table(rows[:60] + rows[80:100] + rows[60:80] + rows[100:])["surge"][-1] == pytest.approx(47.84)
    assert table(rows[::-1]).notes == ("300 rows filed last first turned round",)
    back = [f"{0.01 * i - 0.3 * (i >= 150):.4f},{0.16 * i:.4f}" for i in range(300)]
    with pytest.raises(InputError, match=r"the clock was set back by 0.29 s at row 152"):
        table(back)
    coarse = [f"{0.01 * (i // 10 * 10):.1f},{0.16 * i:.4f}" for i in range(300)]
    with pytest.raises(
        InputError,
        match=r"row 3 repeats the stamp of row 2 with other values \(269 more such\); about 10 rows .*too few digits",
    ):
        table(coarse)


def test_a_header_that_stands_again_is_left_out(tmp_path, plain):
    """A logger that is started again appends to its file."""
    first, *rows = PLAIN.splitlines(keepends=True)
    run = read(tmp_path, first + rows[0] + first + "".join(rows[1:]))
    assert np.array_equal(run.values, plain.values, equal_nan=True)
    assert run.notes == ("1 more header between the rows left out",)


@pytest.mark.parametrize(
    ("times", "notes"),
    [
        (["11:59:59.5 AM", "12:00:00 PM", "12:00:00.25 PM"], 0),
        (["12:59:59.5 am", "1:00:00 am", "1:00:00.25 am"], 0),
        (["12:59:59.5 p.m.", "1:00:00 p.m.", "1:00:00.25 p.m."], 0),
        (["11:59:59.5 PM", "12:00:00 AM", "12:00:00.25 AM"], 1),
        (["23:59:59.5", "00:00:00", "00:00:00.25"], 1),
    ],
)
def test_times_of_day(tmp_path, times, notes):
    run = read(tmp_path, "time,heave\n" + "".join(f"{t},{i}\n" for i, t in enumerate(times)))
    assert np.allclose(run.times, [0.0, 0.5, 0.75]) and len(run.notes) == notes


def test_a_row_that_was_cut_off_is_left_out(tmp_path):
    run = read(tmp_path, "time,surge,heave\n0,1,1\n1,2,2\n2,3")
    assert run.times.tolist() == [0, 1] and run.notes == ("the last row (4) is cut off and left out",)


DATES = {
    "ISO": ["2026-01-01T23:59:59.5", "2026-01-02T00:00:00.0", "2026-01-02T00:00:00.25"],
    "ISO with a blank and a zone": [
        "2026-01-01 23:59:59.500000+01:00",
        "2026-01-02 00:00:00+01:00",
        "2026-01-02 00:00:00.25+01:00",
    ],
    "Zulu": ["2026-01-01T23:59:59.500Z", "2026-01-02T00:00:00.000Z", "2026-01-02T00:00:00.250Z"],
    "German": ["01.02.2026 10:00:59.5", "01.02.2026 10:01:00", "01.02.2026 10:01:00.25"],
    "Python's logging": ["2026-01-01 23:59:59,500", "2026-01-02 00:00:00,000", "2026-01-02 00:00:00,250"],
    "American, past the end of a month": ["01/31/2026 23:59:59.5", "02/01/2026 00:00:00", "02/01/2026 00:00:00.25"],
    "past midnight, the day first": ["01/02/2026 23:59:59.5", "02/02/2026 00:00:00", "02/02/2026 00:00:00.25"],
    "MATLAB": ["29-Nov-2026 10:00:59.500", "29-Nov-2026 10:01:00.000", "29-Nov-2026 10:01:00.250"],
    "the month in words": ["Nov 29 2026 10:00:59.5", "Nov 29 2026 10:01:00", "Nov 29 2026 10:01:00.25"],
    "with the weekday": ["Sun, 29 Nov 2026 10:00:59.5", "Sun, 29 Nov 2026 10:01:00", "Sun, 29 Nov 2026 10:01:00.25"],
    "ms behind a colon": ["10:00:59:500", "10:01:00:000", "10:01:00:250"],
    "time of day": ["10:00:59.500", "10:01:00.000", "10:01:00.250"],
    "stopwatch": ["00:59.5", "01:00.0", "01:00.25"],
}


@pytest.mark.parametrize("kind", DATES)
def test_times_as_dates(tmp_path, kind):
    rows = "".join(f"{t};{i}.5\n" for i, t in enumerate(DATES[kind]))
    run = read(tmp_path, "timestamp;heave\n" + rows)
    assert run.times == pytest.approx([0, 0.5, 0.75], abs=1e-12) and run.seconds_stated
    with pytest.raises(InputError, match="row 3, column 'timestamp': 'noon' is no time like"):
        read(tmp_path, "timestamp;heave\n" + rows.replace(DATES[kind][1], "noon"))


def test_rows_in_another_order_and_repeated(tmp_path):
    run = read(tmp_path, "time,heave\n0,0\n0.2,2\n0.1,1\n0.1,1\n0.3,3\n")
    assert run["heave"].tolist() == [0, 1, 2, 3]
    assert run.notes == (
        "1 row that repeats another exactly left out",
        "1 row filed out of order sorted by their stamps",
    )


def test_a_first_time_of_0_is_no_stamp_before_the_clock_ran(tmp_path):
    run = read(tmp_path, "time,heave\n0,0\n4000000,1\n8000000,2\n")  # ns, not s
    assert len(run.times) == 3 and run.notes == ()
    run = read(tmp_path, "time,heave\n0,0\n1760000000.0,1\n1760000000.1,2\n")
    assert len(run.times) == 2 and run.notes == ("1 row stamped 0 left out: the clock did not run yet",)


def test_columns_for_the_model(tmp_path):
    text = "time,heave,wind speed [km/h],I_bus\n0,1,36,5\n1,2,,6\n"
    run = read(tmp_path, text, inputs={"wind": "wind speed", "drive_current": "I_bus"})
    assert run.channels == ("heave",) and [list(a) for a in run.inputs["wind"]] == [[0.0], [pytest.approx(10.0)]]
    assert run.inputs["drive_current"][1].tolist() == [5, 6] and run.notes == ("converted to SI: wind from km/h",)
    with pytest.raises(
        InputError, match="no column 'I_buss', which inputs: in campaign.yaml asks for; did you mean 'I_bus'"
    ):
        read(tmp_path, text, inputs={"drive_current": "I_buss"})


OTHERS = {
    "workbook": (b"PK\x03\x04" + bytes(50), "is no CSV but a workbook or an archive; save the sheet as CSV"),
    "gzip": (b"\x1f\x8b\x08" + bytes(50), "compressed; unpack it with `gunzip`"),
    "MATLAB": (b"MATLAB 5.0 MAT-file" + bytes(50), "a MATLAB file"),
    "binary": (bytes(range(256)), "is no CSV but a binary file"),
    "binary, mostly of NUL": (b"data" + bytes(300), "is no CSV but a binary file"),
    "a NUL within": (b"time,heave\n0,1\n1,\0002\n", "row 3: a NUL character"),
    "numpy": (b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}\n", "numpy.savetxt"),
    "rich text": (b"{\\rtf1 time,heave}", "rich text"),
    "page behind an empty row": (b"\n <html>", "a page of HTML"),
    "records": (b'[{"time": 0}]', "JSON"),
    "pointer": (b"version https://git-lfs.github.com/spec/v1\n", "git lfs pull"),
    "page": (b"<!DOCTYPE html>", "a page of HTML"),
    "half of UTF-16": ("\ufefftime,heave\n0,1\n".encode("utf-16-le")[:-1], "not UTF-16-LE text"),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_what_is_no_csv_is_named(tmp_path, kind):
    content, message = OTHERS[kind]
    with pytest.raises(InputError, match=message):
        read(tmp_path, content)


CELLS = st.sampled_from(
    [
        "0",
        "1",
        "2.5",
        "-3e-3",
        "1,5",
        "",
        "nan",
        "x",
        '"',
        " ",
        "1e999",
        "1_0",
        "٣",
        "\t",
        ";",
        "#",
        "12:30",
        "2026-01-01",
    ]
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(st.lists(CELLS, min_size=1, max_size=4), max_size=6),
    separator=st.sampled_from([",", ";", "\t", " ", "|"]),
    head=st.sampled_from(
        ["time,heave", "time [ms],heave [mm],status", "t;surge_mm", "# time heave", "Time (s)\troll/deg"]
    ),
)
def test_any_table_is_numbers_or_one_line(tmp_path, rows, separator, head):
    try:
        run = read(tmp_path, "\n".join([head, *(separator.join(r) for r in rows)]))
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 600
    else:
        assert np.isfinite(run.times).all() and (np.diff(run.times) > 0).all() and not np.isinf(run.values).any()


def test_a_last_column_that_rows_leave_out_is_no_channel(tmp_path, plain):
    """`Comment` of LabVIEW: in the header alone, or in some rows."""
    rows = PLAIN.splitlines()
    for comments, how in ((["", "", ""], "any row holds"), (["", ",begin", ""], "most rows hold")):
        text = "\n".join([rows[0] + ",Comment", *(r + c for r, c in zip(rows[1:], comments, strict=True))])
        run = read(tmp_path, text + "\n")
        assert np.array_equal(run.values, plain.values, equal_nan=True) and np.array_equal(run.times, plain.times)
        said = f"the header names one column more than {how}: the last one, 'Comment', is left out"
        assert any(said in note for note in run.notes)


@pytest.mark.parametrize("text", [
    "time,surge,heave,temperature\n0,1,2,20\n1,1,2\n2,1,2,20\n",  # one of four is lost, and which is not known
    "time,surge,sway,heave\n0,1,2\n1,1,2\n2,1,2\n",  # the last is a channel
])  # fmt: skip
def test_a_row_that_may_have_lost_any_cell_is_refused(tmp_path, text):
    with pytest.raises(InputError, match=r"3 cells where the header names 4; (complete|.*delete names that no column)"):
        read(tmp_path, text)


def test_a_header_in_a_comment_above_rows_with_words(tmp_path):
    """`rostopic echo -p`: the frame's name stands among the numbers."""
    rows = "1700000000000000000,0,track,0.5\n1700000000100000000,1,track,0.6\n"
    with pytest.raises(InputError, match=r"row 1: no channel beside 'time' \(there are 'time'; 'field.header.seq'"):
        read(tmp_path, "%time,field.header.seq,field.header.frame_id,field.pose.position.x\n" + rows)
    run = read(tmp_path, "%time,field.header.seq,field.header.frame_id,surge\n" + rows)
    assert run.channels == ("surge",) and run.values.tolist() == [[0.5], [0.6]]


def test_of_long_names_the_ends_are_shown(tmp_path):
    with pytest.raises(InputError, match=r"pose/pose/position/x'; .*pose/pose/position/z'\)"):
        read(
            tmp_path,
            "time,/rig/motion_capture/cradle/pose/pose/position/x,/rig/motion_capture/cradle/pose/pose/position/z\n0,1,2\n1,2,3\n",
        )
