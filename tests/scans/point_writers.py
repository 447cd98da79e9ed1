"""Small point files of each format, written the plain way or by the format's own library."""

import numpy as np

POINTS = np.random.default_rng(7).uniform(-30, 30, (60, 3)).astype(np.float32).astype(np.float64)
"""Float32 numbers, so that every binary format brings them back to the bit, LAS aside."""
UTM = np.array([456_789.12, 5_428_345.67, 118.25])


def write_ply(path, points=POINTS, encoding="binary_little_endian"):
    import trimesh

    if encoding != "binary_big_endian":
        kind = encoding.removesuffix("_little_endian")
        path.write_bytes(trimesh.PointCloud(points.astype(np.float32)).export(file_type="ply", encoding=kind))
        return path
    header = f"ply\nformat {encoding} 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_bytes(header.encode() + points.astype(">f8").tobytes())
    return path


def write_pcd(path, points=POINTS, encoding="binary", viewpoint=None, width=None):
    from pypcd4 import Encoding, PointCloud

    cloud = PointCloud.from_xyz_points(points.astype(np.float32))
    changed = {} if viewpoint is None else {"viewpoint": viewpoint}
    changed |= {} if width is None else {"width": width, "height": len(points) // width}
    for name, value in changed.items():
        setattr(cloud.metadata, name, value)
    cloud.save(path, Encoding(encoding))
    return path


def write_las(path, points=POINTS, scale=0.001, point_format=3, version="1.2"):
    import laspy

    header = laspy.LasHeader(point_format=point_format, version=version)
    header.offsets, header.scales = points.min(axis=0).round(), [scale] * 3
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.write(str(path))
    return path


def write_e57(path, *scans, invalid=None):
    """Scans are points, rotation (w x y z) and translation each; plain points make one scan, which has no pose."""
    import pye57

    with pye57.E57(str(path), "w") as file:
        for points, rotation, translation in scans or [(POINTS, None, None)]:
            marked = np.isnan(points).any(axis=1) if invalid is None else invalid
            data = {f"cartesian{axis}": column for axis, column in zip("XYZ", np.nan_to_num(points).T.copy(), strict=True)}
            data |= {"cartesianInvalidState": marked.astype(np.int8)} if marked.any() else {}
            rotation = None if rotation is None else np.array(rotation)
            file.write_scan_raw(data, rotation=rotation, translation=None if translation is None else np.array(translation))
    return path


def write_npz(path, points=POINTS, **others):
    np.savez_compressed(path, points=points, **others)
    return path


def write_npy(path, points=POINTS):
    np.save(path, points)
    return path


def write_text(path, points=POINTS, header="", delimiter=" "):
    np.savetxt(path, points, fmt="%.17g", header=header, comments="", delimiter=delimiter)
    return path


def write_velodyne(path, points=POINTS):
    np.column_stack([points, np.full(len(points), 0.5)]).astype("<f4").tofile(path)
    return path


WRITERS = {
    "a.ply": write_ply,
    "ascii.ply": lambda path, points=POINTS: write_ply(path, points, "ascii"),
    "big.ply": lambda path, points=POINTS: write_ply(path, points, "binary_big_endian"),
    "a.pcd": write_pcd,
    "ascii.pcd": lambda path, points=POINTS: write_pcd(path, points, "ascii"),
    "packed.pcd": lambda path, points=POINTS: write_pcd(path, points, "binary_compressed"),
    "a.las": write_las,
    "new.las": lambda path, points=POINTS: write_las(path, points, point_format=7, version="1.4"),
    "a.laz": write_las,
    "new.laz": lambda path, points=POINTS: write_las(path, points, point_format=7, version="1.4"),
    "a.e57": lambda path, points=POINTS: write_e57(path, (points, None, None)),
    "a.npy": write_npy,
    "a.npz": write_npz,
    "a.xyz": write_text,
    "a.txt": lambda path, points=POINTS: write_text(path, points, delimiter="\t"),
    "a.csv": lambda path, points=POINTS: write_text(path, points, "x,y,z", ","),
    "a.asc": write_text,
    "a.pts": lambda path, points=POINTS: write_text(path, points, str(len(points))),
    "a.bin": write_velodyne,
}
"""A writer for each kind of file, by a name with the right extension."""


def write_drive(folder, scans, poses, name="{:06d}.bin", write=write_velodyne):
    """A folder of scans (N, 3) each and of poses (3, 4) each; `name` may hold a folder."""
    for number, points in enumerate(scans):
        path = folder / name.format(number)
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, points)
    np.savetxt(folder / "poses.txt", np.reshape(poses, (len(poses), 12)), fmt="%.17g")
    return folder


def random_poses(count, seed=0):
    """(count, 3, 4) rigid motions."""
    rng = np.random.default_rng(seed)
    poses = np.empty((count, 3, 4))
    for pose in poses:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        pose[:, :3], pose[:, 3] = turn * np.sign(np.linalg.det(turn)), rng.uniform(-50, 50, 3)
    return poses
