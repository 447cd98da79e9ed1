import gzip
import math
import os
import threading
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbertvae.checks import InputError
from hilbertvae.scans.carmen import read_carmen
from hilbertvae.scans.carmen_messages import beam_step_deg
from hilbertvae.scans.formats import ReadingSettings, read_scans_path
from toy_rooms import carmen_line, write_log


@pytest.mark.parametrize("name", ["drive.log", "drive.log.gz"])
@pytest.mark.parametrize(("beams", "step_deg"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5)])
def test_what_was_written_is_read_back(tmp_path, name, beams, step_deg):
    rng = np.random.default_rng(beams)
    ranges, poses = rng.uniform(0.1, 20.0, (3, beams)).round(9), rng.uniform(-4, 4, (3, 3)).round(9)
    scans = read_carmen(write_log(tmp_path / name, [carmen_line(*each) for each in zip(ranges, poses, strict=True)]))
    assert len(scans) == 3 * beams and scans.dimension == 2
    row = 0
    for sweep in range(3):
        x, y, heading = poses[sweep]
        for beam in range(beams):
            angle = heading + math.radians(-90 + beam * step_deg)
            end = [x + ranges[sweep, beam] * math.cos(angle), y + ranges[sweep, beam] * math.sin(angle)]
            np.testing.assert_allclose(scans.points[row], end, rtol=0, atol=1e-9)
            assert (scans.scan[row], scans.beam[row]) == (sweep, beam)
            np.testing.assert_array_equal(scans.origins[row], [x, y])
            row += 1


def test_no_return_is_inf_as_well_as_nan(tmp_path):
    """Neither is a range that checks of units and of codes may count."""
    rng = np.random.default_rng(0)
    ranges = rng.uniform(1, 4, (50, 180)).round(3)
    said = {}
    for none in (np.nan, np.inf):
        for name, code, of in (("far", none, 0.7), ("clipped", 8.191, 0.4)):
            some = np.where(rng.random(ranges.shape) < of, code, ranges)
            some[:, 0] = none
            path = write_log(tmp_path / f"{name}.log", [carmen_line(row, [0, 0, 0]) for row in some])
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                read_carmen(path)
            said[name, str(none)] = [str(warning.message).split(":")[1][:30].strip() for warning in caught]
    assert said["far", "nan"] == said["far", "inf"] == []
    assert len(said["clipped", "nan"]) == len(said["clipped", "inf"]) == 1


def test_a_byte_order_mark_hides_no_scan(tmp_path):
    lines = [carmen_line(np.full(180, 3.0), [0, 0, 0]), carmen_line(np.full(180, 3.0), [1, 0, 0])]
    path = write_log(tmp_path / "a.log", lines)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(read_carmen(path)) == 360


def test_no_return_codes_are_skipped(tmp_path):
    ranges = np.full(180, 3.0)
    ranges[[0, 7, 8, 9, 10]] = [81.83, 25.0, 0.0, -1.0, 24.999]
    ranges[[20, 21]] = [np.nan, np.inf]
    scans = read_carmen(write_log(tmp_path / "a.log", [carmen_line(ranges, [0, 0, 0])]), max_range_m=25.0)
    assert set(range(180)) - set(scans.beam.tolist()) == {0, 7, 8, 9, 20, 21}


@pytest.mark.parametrize(("code", "kind"), [(8.191, "FLASER"), (5.6, "FLASER"), (4.095, "FLASER"), (8.191, "ROBOTLASER1")])
def test_a_no_return_code_that_could_be_a_range_is_told(tmp_path, code, kind):
    """As lasers have it that count millimetres in 13 bits; 4 of 100 beams saw nothing, so that the map would have a wall there."""
    rng = np.random.default_rng(0)
    ranges = rng.uniform(1, 4, (50, 180)).round(3)
    ranges[:, ::25] = code
    head = "FLASER 180" if kind == "FLASER" else f"ROBOTLASER1 0 -1.57 3.14 {math.pi / 180} 80 0.01 0 180"
    tail = "0 0 0 0 0 0 1.0 host 1.0" if kind == "FLASER" else "0 0 0 0 0 0 0 0.1 0.2 0.5 0.4 0.0 1.0 host 1.0"
    path = write_log(tmp_path / "a.log", [f"{head} {' '.join(map(str, row))} {tail}\n" for row in ranges])
    said = rf"a.log: 4.4 % of all ranges are the largest, {code} m: .* Set reading.max_range_m={code} to drop them"
    with pytest.warns(UserWarning, match=said):
        read_carmen(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_carmen(path, max_range_m=code)) == (ranges < code).sum()


@pytest.mark.parametrize("times", [0, 1, 150])
def test_a_far_range_that_few_beams_have_is_a_range(tmp_path, times):
    """150 of 9000 are fewer than 2 %."""
    ranges = np.random.default_rng(0).uniform(1, 8, (50, 180)).round(3)
    ranges.flat[np.random.default_rng(1).choice(ranges.size, times, replace=False)] = 8.191
    path = write_log(tmp_path / "a.log", [carmen_line(row, [0, 0, 0]) for row in ranges])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_carmen(path)


def test_every_keeps_the_order_and_counts_only_laser_lines(tmp_path):
    lines = [carmen_line(np.full(180, 1.0 + k), [k, 0, 0]) for k in range(7)]
    for k in (2, 4):
        lines.insert(k, carmen_line([9.0] * 180, [0, 0, 0], command="RLASER") + "ODOM 1 2 3 4 5 6 7 host 8\n")
    path = write_log(tmp_path / "a.log", lines)
    np.testing.assert_array_equal(np.unique(read_carmen(path, every=3).origins[:, 0]), [0, 3, 6])
    np.testing.assert_array_equal(np.unique(read_carmen(path, every=3).scan), [0, 1, 2])
    np.testing.assert_array_equal(np.unique(read_carmen(path).origins[:, 0]), range(7))


def test_other_beams_than_the_usual(tmp_path):
    assert [beam_step_deg(beams) for beams in (180, 181, 360, 361)] == [1.0, 1.0, 0.5, 0.5]
    path = write_log(tmp_path / "a.log", [carmen_line([2.0, 2.0, 2.0], [0, 0, 0])])
    scans = read_carmen(path, step_deg=90.0)
    np.testing.assert_allclose(scans.points, [[0, -2], [2, 0], [0, 2]], atol=1e-12)
    np.testing.assert_array_equal(read_scans_path(path, ReadingSettings(beam_step_deg=90.0)).points, scans.points)
    with pytest.warns(
        UserWarning,
        match="a.log: 3 beams taken to be 1 degrees apart, a guess, since this reader knows no laser of so many; set reading.beam_step_deg",
    ):
        read_carmen(path)
    with pytest.raises(InputError, match="reading.beam_step_deg: expected a positive number"):
        read_scans_path(path, ReadingSettings(beam_step_deg=0.0))


@pytest.mark.parametrize(
    ("beams", "first_deg", "last_deg"),
    [(541, -135, 135), (1081, -135, 135), (721, -90, 90), (181, -90, 90), (361, -90, 90), (180, -90, 89), (360, -90, 89.5)]
    + [(count, -(count - 1) * 360 / 2048, (count - 1) * 360 / 2048) for count in (682, 683, 726, 769)],
)
def test_how_far_a_laser_looks(tmp_path, beams, first_deg, last_deg, recwarn):
    scans = read_carmen(write_log(tmp_path / "a.log", [carmen_line(np.full(beams, 2.0), [0, 0, 0])]))
    angles = np.rad2deg(np.arctan2(*scans.points.T[::-1]))
    np.testing.assert_allclose(angles[[0, -1]], [first_deg, last_deg], atol=1e-9)
    assert len(scans) == beams and not recwarn.list


@pytest.mark.parametrize("name", ["a.log", "a.log.gz"])
@pytest.mark.parametrize("kept", [0.05, 0.5, 0.99])
def test_a_last_line_that_is_cut_off_is_left_out(tmp_path, name, kept):
    """One that lacks nothing but its end is read, and the only one of a log is refused."""
    *lines, last = good_lines(5)
    with pytest.warns(UserWarning, match=f"{name}, line 7: the last line is cut off and left out"):
        scans = read_carmen(write_log(tmp_path / name, [*lines, last[: int(kept * len(last))]]))
    assert set(scans.scan) == set(range(4))
    assert set(read_carmen(write_log(tmp_path / name, [*lines, last.rstrip()])).scan) == set(range(5))
    with pytest.raises(InputError, match=f"{name}, line 3: "):
        read_carmen(write_log(tmp_path / name, [last[: len(last) // 2]]))
    with pytest.raises(InputError, match=f"{name}, line 4: truncated"):  # a damaged one, and the log goes on
        read_carmen(write_log(tmp_path / name, [lines[0], last[: len(last) // 2] + "\n", *lines[1:]]))


def test_any_blanks_part_fields(tmp_path):
    lines = good_lines(3)
    odd = ["\t" + lines[0], "  " + lines[1].replace(" ", "  "), " \n", lines[2].replace(" ", "\t")]
    expected, found = read_carmen(write_log(tmp_path / "a.log", lines)), read_carmen(write_log(tmp_path / "b.log", odd))
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.scan, expected.scan)


@settings(max_examples=50)
@given(st.data())
def test_damage_is_read_or_named(tmp_path_factory, data):
    """Bytes changed anywhere, also in the packed file: scans, or one error with the file's name."""
    name = data.draw(st.sampled_from(["a.log", "a.log.gz"]))
    path = write_log(tmp_path_factory.mktemp("damage") / name, [carmen_line(np.full(180, 3.0), [k, 0, 0]) for k in range(3)])
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            assert np.isfinite(read_carmen(path).points).all()
        except InputError as error:
            assert str(path) in str(error)


def good_lines(count=50):
    rng = np.random.default_rng(0)
    return [carmen_line(rng.uniform(1, 9, 180), [k, 0, 0]) for k in range(count)]


def test_a_missing_log(tmp_path):
    with pytest.raises(InputError, match="nowhere.log.*no such file"):
        read_carmen(tmp_path / "nowhere.log")


def test_a_folder_instead_of_a_log(tmp_path):
    with pytest.raises(InputError, match="can't be read as a CARMEN log"):
        read_carmen(tmp_path)


def test_a_truncated_gzip(tmp_path):
    whole = write_log(tmp_path / "whole.log.gz", good_lines()).read_bytes()
    path = tmp_path / "half.log.gz"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="half.log.gz.*truncated"):
        read_carmen(path)


@pytest.mark.parametrize("place", [0.3, 0.6])
def test_a_damaged_gzip(tmp_path, place):
    content = bytearray(write_log(tmp_path / "whole.log.gz", good_lines()).read_bytes())
    middle = int(place * len(content))
    content[middle : middle + 200] = bytes(200)
    path = tmp_path / "damaged.log.gz"
    path.write_bytes(content)
    with pytest.raises(InputError, match="damaged.log.gz"):
        read_carmen(path)


def test_a_gzip_header_with_nothing_behind_it(tmp_path):
    path = tmp_path / "head.log.gz"
    path.write_bytes(gzip.compress(b"")[:5])
    with pytest.raises(InputError, match="head.log.gz"):
        read_carmen(path)


FOREIGN = {
    "empty": b"",
    "picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 8,
    "table": b"x,y,z\n1,2,3\n",
    "packed": gzip.compress(b"ODOM 1 2 3\n"),
}


# By name: gzip writes the time into its header, and a test's name must not depend on when it was collected.
@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN)
def test_a_foreign_file(tmp_path, content):
    path = tmp_path / "foreign.log"
    path.write_bytes(content)
    with pytest.raises(InputError, match="foreign.log: expected a CARMEN log with FLASER or ROBOTLASER1 lines, found none"):
        read_carmen(path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("FLASER 180 1.0 2.0 0 0 0\n", "line 3: truncated; 180 ranges and a pose claimed, 5 numbers found"),
        ("FLASER 3 1.0 2.0 3.0 0.5 0.5\n", "line 3: truncated"),
        ("FLASER 1000000000 1.0 0 0 0\n", "line 3: expected at most 4096 ranges, the line claims 1000000000"),
        (f"FLASER {'9' * 5000} 1.0 0 0 0\n", "line 3: expected"),
        ("FLASER 0 1.0 0 0 0\n", "expected ranges of 0.0 to 30.0 m, found none in 1 scans"),
        ("FLASER -3 1.0 0 0 0\n", "line 3: expected 'FLASER <number of ranges>"),
        ("FLASER \n", "line 3: expected 'FLASER <number of ranges>"),
        ("FLASER 1 one 0 0 0 \n", "line 3: expected numbers"),
        ("FLASER 1 1.0 nan 0 0\n", "line 3: expected a finite pose"),
        ("FLASER 1 1.0 0 0 inf\n", "line 3: expected a finite pose"),
        ("FLASER 2 81.83 0.0 0 0 0\n", "expected ranges of 0.0 to 30.0 m, found none in 1 scans"),
    ],
)
def test_bad_lines_are_named(tmp_path, line, message):
    with pytest.raises(InputError, match=f"bad.log.*{message}"):
        read_carmen(write_log(tmp_path / "bad.log", [line]))


@pytest.mark.parametrize("options", [{"every": 0}, {"max_range_m": 0.0}, {"max_range_m": np.nan}])
def test_bad_options_are_named(tmp_path, options):
    with pytest.raises(InputError, match=next(iter(options))):
        read_carmen(write_log(tmp_path / "a.log", good_lines(2)), **options)


def test_a_packed_line_without_end_is_refused_before_it_fills_the_memory(tmp_path):
    path = tmp_path / "zeros.log.gz"
    path.write_bytes(gzip.compress(bytes(1 << 22)))
    with pytest.raises(InputError, match="zeros.log.gz, line 1: expected a CARMEN log, got a line of more than"):
        read_carmen(path)


def test_a_log_is_read_from_a_pipe(tmp_path):
    """Which can't be opened twice."""
    lines = "\n".join(carmen_line(np.full(180, 3.0), (x, 0, 0)) for x in (0.0, 0.5)) + "\n"
    for name, content in (("plain.log", lines.encode()), ("packed.log.gz", gzip.compress(lines.encode()))):
        os.mkfifo(tmp_path / name)
        writer = threading.Thread(target=(tmp_path / name).write_bytes, args=(content,))
        writer.start()
        assert read_carmen(tmp_path / name).scan.max() == 1
        writer.join()


@pytest.mark.parametrize("rear", ["RLASER", "ROBOTLASER2"])
def test_a_second_laser_is_told_of(tmp_path, rear):
    front = carmen_line(np.full(180, 3.0), (0.0, 0, 0))
    path = write_log(tmp_path / "drive.log", [front, front.replace("FLASER", rear, 1)])
    with pytest.warns(UserWarning, match=f"read are its 1 FLASER messages alone, and not 1 {rear} ones, of a second laser"):
        assert read_carmen(path).scan.max() == 0


def test_a_packed_log_that_grows_beyond_all_logs_is_refused(tmp_path):
    line = (carmen_line(np.full(180, 3.0), (0.0, 0, 0)) + "\n").encode()
    with gzip.open(tmp_path / "bomb.log.gz", "wb") as file:
        for _ in range(70):
            file.write(line * (2**20 // len(line)))
    with pytest.raises(InputError, match="bomb.log.gz: truncated or forged; its lines claim to unpack"):
        read_carmen(tmp_path / "bomb.log.gz")
