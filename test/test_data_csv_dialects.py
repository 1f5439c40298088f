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
    "UTF-32": PLAIN.encode("utf-32"),
    "capitals": PLAIN.replace("time", "Time").replace("surge", "SURGE"),
    "no number": PLAIN.replace(",,", ",NaN,"),
    "no number either": PLAIN.replace(",,", ",#N/A,"),
    "a dash": PLAIN.replace(",,", ",-,"),
    "plus signs": PLAIN.replace("1.5", "+1.5"),
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
    "in a row in brackets": "time,surge,heave\n[ms],[mm],[µm]\n0,1500,-5000\n100,,-4000\n250,250,-3000\n",
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
    "time of day": ["10:00:59.500", "10:01:00.000", "10:01:00.250"],
    "stopwatch": ["00:59.5", "01:00.0", "01:00.25"],
}


@pytest.mark.parametrize("kind", DATES)
def test_times_as_dates(tmp_path, kind):
    rows = "".join(f"{t},{i}\n" for i, t in enumerate(DATES[kind]))
    run = read(tmp_path, "timestamp,heave\n" + rows)
    assert run.times == pytest.approx([0, 0.5, 0.75], abs=1e-12) and run.seconds_stated
    with pytest.raises(InputError, match="row 3, column 'timestamp': 'noon' is no time like"):
        read(tmp_path, "timestamp,heave\n" + rows.replace(DATES[kind][1], "noon"))


def test_rows_in_another_order_and_repeated(tmp_path):
    run = read(tmp_path, "time,heave\n0,0\n0.2,2\n0.1,1\n0.1,1\n0.3,3\n")
    assert run["heave"].tolist() == [0, 1, 2, 3]
    assert run.notes == (
        "2 rows filed out of order sorted by their stamps",
        "1 row that repeats another exactly left out",
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
    "binary": (bytes(range(256)), "row 1: a NUL character"),
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
