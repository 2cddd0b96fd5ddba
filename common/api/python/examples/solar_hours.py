#!/usr/bin/env python3
"""Hours of direct sun on the facades of a city, on one day, as a coloured PLY of points.

    quarry scene city --triangles 1000000 -o city.ply
    python3 solar_hours.py city.ply hours.ply --latitude 48.1 --day 80

Usage: solar_hours.py SCENE OUT.ply [--latitude DEGREES] [--day 1-365] [--spacing UNITS] [--step MINUTES]
SCENE: a store, or a model, with z up and y to the north. Every facade that a horizontal line meets gets a point: lines along x and y, `spacing` apart."""
import argparse
import math

import numpy
import quarry


def sun_directions(latitude, day, step):
    """Unit vectors toward the sun at each step of solar time, while it is up. x: east, y: north. Declination by Cooper's formula (1969)."""
    declination = math.radians(23.45) * math.sin(2 * math.pi * (284 + day) / 365)
    phi = math.radians(latitude)
    hours = numpy.arange(step / 120, 24, step / 60)
    angle = numpy.radians(15 * (hours - 12))
    up = math.sin(phi) * math.sin(declination) + math.cos(phi) * math.cos(declination) * numpy.cos(angle)
    north = math.cos(phi) * math.sin(declination) - math.sin(phi) * math.cos(declination) * numpy.cos(angle)
    east = -math.cos(declination) * numpy.sin(angle)
    return numpy.stack([east, north, up], axis=1)[up > 0.01]


def facade_points(scene, spacing):
    """Points and outward normals where horizontal lines along x and y enter a steep surface from outside."""
    lower, upper = scene.bounds
    found = []
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        other = 1 - axis
        across, height = (numpy.arange(lower[a] + spacing / 2, upper[a], spacing) for a in (other, 2))
        across, height = (grid.ravel() for grid in numpy.meshgrid(across, height))
        rays = numpy.zeros((len(across), 6))
        rays[:, axis] = lower[axis] - 1 if sign > 0 else upper[axis] + 1
        rays[:, other], rays[:, 2], rays[:, 3 + axis] = across, height, sign
        hits = scene.list_intersections(rays, fields=("t_hit", "primitive_normals"))
        from_ray = rays[hits["ray_ids"]]
        normals = hits["primitive_normals"].astype(numpy.float64)
        enters = (normals * from_ray[:, 3:]).sum(axis=1) < -0.3
        steep = numpy.abs(normals[:, 2]) < 0.3
        points = from_ray[:, :3] + from_ray[:, 3:] * hits["t_hit"][:, None]
        found.append((points[enters & steep], normals[enters & steep]))
    return (numpy.concatenate(arrays) for arrays in zip(*found))


def solar_hours(scene, points, normals, suns, step):
    """Hours for each point. A point is lit where it faces the sun and nothing stands between."""
    size = numpy.linalg.norm(scene.bounds[1] - scene.bounds[0])
    starts = points + normals * (1e-5 * size)
    hours = numpy.zeros(len(points))
    for sun in suns:
        facing = numpy.flatnonzero(normals @ sun > 0)
        rays = numpy.concatenate([starts[facing], numpy.broadcast_to(sun, (len(facing), 3))], axis=1)
        hours[facing[~scene.test_occlusions(rays)]] += step / 60
    return hours


def write_ply(path, points, values):
    """Points from blue (0) by green to red (the largest value)."""
    share = values / max(values.max(initial=0), 1e-9)
    colors = numpy.stack([numpy.clip(2 * share - 1, 0, 1), 1 - numpy.abs(2 * share - 1), numpy.clip(1 - 2 * share, 0, 1)], axis=1)
    rows = numpy.empty(len(points), dtype=[("at", "<f4", 3), ("color", "u1", 3), ("hours", "<f4")])
    rows["at"], rows["color"], rows["hours"] = points, (255 * colors).astype(numpy.uint8), values
    names = [f"property float {a}" for a in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")] + ["property float hours"]
    with open(path, "wb") as out:
        out.write("\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *names, "end_header", ""]).encode())
        out.write(rows.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("out")
    parser.add_argument("--latitude", type=float, default=48.1)
    parser.add_argument("--day", type=int, default=80)
    parser.add_argument("--spacing", type=float, default=0, help="default: a 300th of the city's width")
    parser.add_argument("--step", type=float, default=30, help="minutes")
    options = parser.parse_args()
    with quarry.Scene(options.scene) as scene:
        lower, upper = scene.bounds
        points, normals = facade_points(scene, options.spacing or (upper[0] - lower[0]) / 300)
        hours = solar_hours(scene, points, normals, sun_directions(options.latitude, options.day, options.step), options.step)
    write_ply(options.out, points, hours)
    print(f"{len(points)} points; sun for {hours.mean():.2f} hours in the mean, {hours.max():.2f} at most; {100 * (hours == 0).mean():.1f} % have none")


if __name__ == "__main__":
    main()
