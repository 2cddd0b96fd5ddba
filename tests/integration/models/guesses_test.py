"""Guesses about a model (its up axis, its origin, the part in the frame, whether it is a room) stay when the file says the same in another way:
doubled faces, reversed windings, another order, comments first, another scale, a stray point."""
import copy
import pathlib
import random
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[3]))
from tests.integration.pictures.pictures_test import png
from tests.integration.programs import Case, main
from tests.support.models import first_models


MODELS = {"bust": first_models.bust, "tower": lambda: first_models.tower(6), "car on a plate": lambda: first_models.car(n=40), "room": first_models.lit_room}


def changed(mesh, triangles):
    other = copy.copy(mesh)
    other.triangles = triangles
    return other


def variants(mesh):
    """(name, mesh, comments, scale) of the same thing."""
    triangles = mesh.triangles
    backs = [(c, b, a) for a, b, c in triangles]
    shuffled = triangles[:]
    random.Random(5).shuffle(shuffled)
    largest = max(abs(v) for t in triangles for p in t for v in p)
    far = 40 * largest
    stray = [(far, far, far), (far + 0.01, far, far), (far, far + 0.01, far)]
    yield "doubled faces", changed(mesh, triangles + triangles), (), 1
    yield "two sides", changed(mesh, triangles + backs), (), 1
    yield "reversed windings", changed(mesh, backs), (), 1
    yield "another order", changed(mesh, shuffled), (), 1
    yield "comments first", mesh, ("a thing", "made by hand", "with 4 parts") * 20, 1
    yield "another scale", mesh, (), 0.001
    yield "a stray point", changed(mesh, triangles + [tuple(stray)]), (), 1


class Guesses(Case):
    def guess(self, mesh, comments, scale, ending, up):
        """The up axis, and the camera's eye and middle in the model's coordinates over the scale."""
        model, store, picture = (self.path(name) for name in ("m" + ending, "m.quarry", "m.png"))
        mesh = copy.copy(mesh)
        mesh.parts = []
        first_models.save(mesh, model, up, comments, scale)
        self.must("quarry-preprocess", model, "-o", store, "--quiet", "--force")
        self.must("quarry", "render", store, "-o", picture, "--quiet", "--force", "--size", "48x32", "--spp", 1, "--workers", 1)
        eye, at = ([float(v) / scale for v in text.split(",")] for text in re.match(r"eye (\S+) at (\S+) ", png(picture)[0]["Camera"]).groups())
        return self.info(store)["up_axis"], eye, at

    def test_the_same_object_written_differently_has_the_same_view(self):
        for number, (name, make) in enumerate(MODELS.items()):
            mesh, (ending, up) = make(), ((".obj", "y"), (".stl", "z"), (".ply", "z"), (".ply", "y"))[number % 4]
            axis, eye, at = self.guess(mesh, (), 1, ending, up)
            self.assertEqual(axis, up, name)
            away = max(abs(a - b) for a, b in zip(eye, at))
            for variant, other, comments, scale in variants(mesh):
                with self.subTest(model=name, variant=variant):
                    axis, seen, middle = self.guess(other, comments, scale, ending, up)
                    self.assertEqual(axis, up)
                    for a, b in zip(seen + middle, eye + at):
                        self.assertAlmostEqual(a, b, delta=0.06 * away)

    def test_a_model_far_from_zero_keeps_its_origin(self):
        for variant, mesh, comments, _ in variants(first_models.bust()):
            with self.subTest(variant=variant):
                moved = changed(mesh, [tuple((x + 5e5, y + 4e6, z) for x, y, z in t) for t in mesh.triangles])
                first_models.save(moved, self.path("far.stl"), "z", comments)
                self.must("quarry-preprocess", self.path("far.stl"), "-o", self.path("far.quarry"), "--quiet", "--force")
                self.assertEqual(self.info(self.path("far.quarry"))["offset"][:2], [488 * 1024, 3906 * 1024])

    def test_comments_decide_where_triangles_give_no_evidence(self):
        ball = first_models.Mesh()
        ball.sphere((0, 0, 0), 1, 24)
        for ending, comment, up in ((".obj", "Blender 4.0", "y"), (".ply", "Created by Blender 4.0", "z"), (".obj", "Z-up, millimetres", "z"),
                                    (".ply", "Up axis: Y", "y"), (".obj", "", "y"), (".stl", "", "z")):
            with self.subTest(ending=ending, comment=comment):
                self.assertEqual(self.guess(ball, (comment,), 1, ending, "z")[0], up)


if __name__ == "__main__":
    main()
