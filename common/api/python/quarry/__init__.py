"""Rays through triangle models that do not fit memory.

A scene is a store that `quarry preprocess` has made, in a file or on a server, or a model, which is preprocessed first. Its voxels are read when rays need
them, into a cache of fixed size. Rays that pass between two triangles which share an edge do not exist: hits are watertight.

    import numpy, quarry

    with quarry.Scene("plant.quarry", cache="2G") as scene:
        rays = numpy.array([[10, 20, 30, 0, 0, -1]], dtype=numpy.float64)   # origin, direction
        hits = scene.cast_rays(rays)
        print(hits["t_hit"], [scene.parts[i] for i in hits["geometry_ids"] if i != quarry.INVALID_ID])

Names and shapes follow Open3D's RaycastingScene. Positions are the model's own; `t` counts lengths of the direction as given.
"""
from ._errors import ArgumentError, CancelledError, DataError, Error, ForkedError, ProcessorError, SourceError
from ._library import INVALID_ID, version
from ._names import Names
from ._scene import Scene

__all__ = ["ArgumentError", "CancelledError", "DataError", "Error", "ForkedError", "INVALID_ID", "Names", "ProcessorError", "Scene", "SourceError", "version"]
__version__ = version()
