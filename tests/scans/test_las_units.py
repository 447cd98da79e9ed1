import io
import struct
import warnings

import numpy as np
import pytest
from point_writers import POINTS, write_las

from hilbertvae.checks import InputError
from hilbertvae.scans.las import read_las
from hilbertvae.scans.las_units import EXTENDED_HEAD, metres_per_unit, system_records

FOOT, US_FOOT = 0.3048, 1200 / 3937
US = 'UNIT["US survey foot",0.3048006096012192,AUTHORITY["EPSG","9003"]]'
DEGREES = 'GEOGCS["NAD83",DATUM["d",SPHEROID["s",6378137,298.25]],UNIT["degree",0.0174532925199433]]'


def record(user, number, content):
    return struct.pack("<2x16sHH32x", user, number, len(content)) + content


def geo_keys(*keys):
    return record(b"LASF_Projection", 34735, struct.pack(f"<{4 + 4 * len(keys)}H", 1, 1, 0, len(keys), *np.ravel(keys).astype(int)))


def wkt(text):
    return record(b"LASF_Projection", 2112, text.encode() + b"\0")


@pytest.mark.parametrize(
    ("records", "expected"),
    [
        ([], [1, 1, 1]),
        ([geo_keys((3076, 0, 1, 9003))], [US_FOOT] * 3),
        ([geo_keys((1024, 0, 1, 1), (3076, 0, 1, 9002), (4099, 0, 1, 9001))], [FOOT, FOOT, 1]),
        ([geo_keys((3076, 0, 1, 9001), (4099, 0, 1, 9003))], [1, 1, US_FOOT]),
        ([geo_keys((3076, 34736, 1, 9002))], [1, 1, 1]),  # its value is elsewhere
        ([record(b"somebody", 34735, b"\1\0" * 8), geo_keys((3076, 0, 1, 9002))], [FOOT] * 3),
        ([wkt(f'PROJCS["p",{DEGREES},{US}]')], [0.3048006096012192] * 3),
        ([wkt(f'PROJCS["p",{DEGREES},UNIT["metre",1]]')], [1, 1, 1]),
        (
            [wkt(f'COMPD_CS["c",PROJCS["p",{DEGREES},{US}],VERT_CS["v",VERT_DATUM["d",2005],UNIT["metre",1]]]')],
            [0.3048006096012192] * 2 + [1],
        ),
        ([wkt(f'COMPD_CS["c",PROJCS["p",{DEGREES},UNIT["metre",1]],VERT_CS["v",{US}]]')], [1, 1, 0.3048006096012192]),
        (
            [wkt(f'PROJCS["p",{DEGREES},UNIT["Meter",1.0]],VERTCS["v",VDATUM["d"],UNIT["Foot_US",0.3048006096012192]]')],
            [1, 1, 0.3048006096012192],
        ),
        ([wkt('PROJCRS["p",CS[Cartesian,2],AXIS["x",east],LENGTHUNIT["foot", 0.3048]]')], [FOOT] * 3),
        ([wkt("PROJCS[")], [1, 1, 1]),
        ([geo_keys((3076, 0, 1, 9002))[:60]], [1, 1, 1]),  # cut off
    ],
)
def test_what_records_say(records, expected):
    found = system_records(io.BytesIO(b"".join(records)), 0, len(records))
    np.testing.assert_allclose(metres_per_unit(found, "a.las"), expected, rtol=1e-12)


GEOGRAPHIC = [
    [geo_keys((1024, 0, 1, 2), (2048, 0, 1, 4326))],
    [wkt(DEGREES)],
    [wkt(f'COMPD_CS["c",{DEGREES},VERT_CS["v",{US}]]')],
    [wkt('GEOGCRS["WGS 84, no PROJCRS[",CS[ellipsoidal,2],ANGLEUNIT["degree",0.0174532925199433]]')],
    [geo_keys((1024, 0, 1, 1), (3072, 0, 1, 32632)), wkt(DEGREES)],
]
PLANE = [
    [geo_keys((1024, 0, 1, 1))],
    [geo_keys((1024, 0, 1, 2)), wkt(f'PROJCS["p",{DEGREES},UNIT["metre",1]]')],
    [wkt('PROJCRS["p",BASEGEOGCRS["b",DATUM["d"]],CS[Cartesian,2],LENGTHUNIT["metre",1]]')],
    [wkt('LOCAL_CS["of a site, once GEOGCS[",UNIT["metre",1]]')],
]


@pytest.mark.parametrize("records", GEOGRAPHIC)
def test_degrees_are_refused(records):
    found = system_records(io.BytesIO(b"".join(records)), 0, len(records))
    with pytest.raises(InputError, match="a.las: its coordinates are degrees, as its header says, .* project them first"):
        metres_per_unit(found, "a.las")


@pytest.mark.parametrize("records", PLANE)
def test_metres_of_a_plane_are_not(records):
    found = system_records(io.BytesIO(b"".join(records)), 0, len(records))
    np.testing.assert_array_equal(metres_per_unit(found, "a.las"), [1, 1, 1])


@pytest.mark.parametrize("code", [2225, 2263, 6543])
def test_a_code_that_may_be_of_feet_is_told_of(code):
    records = [geo_keys((1024, 0, 1, 1), (3072, 0, 1, code))]
    with pytest.warns(UserWarning, match=rf"a.las: its header has EPSG's code {code} and no unit; metres are taken. If .* key 3076: 9002"):
        np.testing.assert_array_equal(metres_per_unit(system_records(io.BytesIO(b"".join(records)), 0, 1), "a.las"), [1, 1, 1])


@pytest.mark.parametrize(
    "keys", [[(3072, 0, 1, code)] for code in (0, 32767, 25832, 26918, 32633, 32733)] + [[(3072, 0, 1, 2225), (3076, 0, 1, 9001)]]
)
def test_a_code_of_utm_or_one_with_its_unit_is_not(keys):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        metres_per_unit(system_records(io.BytesIO(geo_keys(*keys)), 0, 1), "a.las")


@pytest.mark.parametrize("name", ["new.las", "new.laz"])
@pytest.mark.parametrize("length", [None, 2**63], ids=["sound", "forged length"])
def test_records_behind_the_points_say_it_too(tmp_path, name, length):
    path = write_las(tmp_path / name, point_format=7, version="1.4")
    plain, text = path.read_bytes(), f'PROJCS["p",{DEGREES},{US}]'.encode()
    others = EXTENDED_HEAD.pack(b"copc", 1000, 3) + b"\0\1\2"
    behind = others + EXTENDED_HEAD.pack(b"LASF_Projection", 2112, length or len(text)) + text
    path.write_bytes(plain[:235] + struct.pack("<QI", len(plain), 2) + plain[247:] + behind)
    with pytest.warns(UserWarning, match="in feet"):
        np.testing.assert_allclose(read_las(path).points, 0.3048006096012192 * POINTS, atol=1e-3)


def written_with(path, *keys):
    laspy = pytest.importorskip("laspy")
    with laspy.open(write_las(path)) as opened:
        header, packed = opened.header, opened.read()
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, record_data=geo_keys(*keys)[54:]))
    given = laspy.LasData(header)
    given.x, given.y, given.z = packed.x, packed.y, packed.z
    given.write(str(path))
    return path


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_feet_become_metres_with_a_warning(tmp_path, name):
    path = written_with(tmp_path / name, (3076, 0, 1, 9003))
    with pytest.warns(UserWarning, match=f"{name}: its coordinates are in feet, as its header says, and are made metres"):
        points = read_las(path).points
    np.testing.assert_allclose(points, POINTS * US_FOOT, atol=0.001)


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_a_file_in_degrees_is_refused(tmp_path, name):
    path = written_with(tmp_path / name, (1024, 0, 1, 2))
    with pytest.raises(InputError, match=f"{name}: its coordinates are degrees"):
        read_las(path)
