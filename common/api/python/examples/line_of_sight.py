#!/usr/bin/env python3
"""What is in sight of a point above a terrain, as a coloured PLY of the ground: green what is seen, grey what is hidden.

    python3 line_of_sight.py terrain.ply 6.8 45.8 seen.ply --height 0.02

Usage: line_of_sight.py SCENE X Y OUT.ply [--height UNITS] [--target UNITS] [--points COUNT]
SCENE: a store, or a model, with z up, in its own units. The observer stands `height` above the ground at (X, Y); a place of the ground is seen if a
target `target` above it is. The earth's curve is left out."""
import argparse

import numpy
import quarry


def ground_below(scene, x, y):
    """The height of the ground at each place; inf where there is none."""
    top = scene.bounds[1][2]
    step = max(1.0, abs(top))  # so far above that the ray begins outside
    rays = numpy.stack([x, y, numpy.full(x.shape, top + step), *(numpy.full(x.shape, v) for v in (0.0, 0.0, -1.0))], axis=-1)
    return top + step - scene.cast_rays(rays, fields=("t_hit",))["t_hit"]


def visible(scene, eye, targets):
    """Whether a straight line from `eye` reaches each target: the direction is the whole way, so that t is 1 there."""
    rays = numpy.concatenate([numpy.broadcast_to(eye, targets.shape), targets - eye], axis=1)
    return ~scene.test_occlusions(rays, tfar=1.0)


def write_ply(path, points, seen):
    rows = numpy.empty(len(points), dtype=[("at", "<f4", 3), ("color", "u1", 3)])
    rows["at"], rows["color"] = points, numpy.where(seen[:, None], (60, 190, 80), (110, 110, 110))
    names = [f"property float {a}" for a in "xyz"] + [f"property uchar {c}" for c in ("red", "green", "blue")]
    with open(path, "wb") as out:
        out.write("\n".join(["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *names, "end_header", ""]).encode())
        out.write(rows.tobytes())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("x", type=float)
    parser.add_argument("y", type=float)
    parser.add_argument("out")
    parser.add_argument("--height", type=float, default=2)
    parser.add_argument("--target", type=float, default=0, help="default: a millionth of the model's size")
    parser.add_argument("--points", type=int, default=1_000_000)
    options = parser.parse_args()
    with quarry.Scene(options.scene) as scene:
        lower, upper = scene.bounds
        side = max(2, round(options.points ** 0.5))
        x, y = (grid.ravel() for grid in numpy.meshgrid(*(numpy.linspace(lower[a], upper[a], side + 2)[1:-1] for a in (0, 1))))
        z = ground_below(scene, x, y)
        points = numpy.stack([x, y, z], axis=1)[numpy.isfinite(z)]
        eye = numpy.array([options.x, options.y, 0.0])
        eye[2] = ground_below(scene, *eye[None, :2].T)[0] + options.height
        if not numpy.isfinite(eye[2]):
            parser.error(f"there is no ground at {options.x}, {options.y}; the model lies between {lower[:2]} and {upper[:2]}")
        lift = options.target or 1e-6 * numpy.linalg.norm(upper - lower)
        seen = visible(scene, eye, points + [0, 0, lift])
    write_ply(options.out, points, seen)
    print(f"{100 * seen.mean():.1f} % of {len(points)} places are in sight of {eye.tolist()}")


if __name__ == "__main__":
    main()
