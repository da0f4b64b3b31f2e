"""What pymunk's batch calls read and write of all bodies at once, and their addresses, checked before use.

These are pymunk's insides, and may change with any version. A compiled kernel calls them by address, where a change
would crash the process or spoil numbers; therefore `check` compares them with what they were when this was written.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
import pymunk
from numpy.typing import NDArray
from pymunk import batch
from pymunk._chipmunk_cffi import ffi, lib

from swarmsim.core.errors import InputError

READ: Final = (
    batch.BodyFields.POSITION | batch.BodyFields.ANGLE | batch.BodyFields.VELOCITY | batch.BodyFields.ANGULAR_VELOCITY
)
WRITE: Final = batch.BodyFields.FORCE | batch.BodyFields.TORQUE
VISIT: Final = "void(*)(struct cpBody *, void *)"
#: In the order in which `drive.roll` takes their addresses, with their types in C.
FUNCTIONS: Final = {
    "cpSpaceStep": "void(*)(struct cpSpace *, double)",
    "cpSpaceEachBody": f"void(*)(struct cpSpace *, {VISIT}, void *)",
    "pmSpaceBodySetIteratorFuncBatched": VISIT,
    "pmSpaceBodyGetIteratorFuncBatched": VISIT,
}
#: The fields that are used here of each struct: name, type, offset in bytes.
STRUCTS: Final = {
    "struct pmBatchedData": (
        ("intArray", "struct pmIntArray *", 0),
        ("floatArray", "struct pmFloatArray *", 8),
        ("fields", "enum pmBatchableBodyFields", 16),
    ),
    "struct pmFloatArray": (("num", "int", 0), ("max", "int", 4), ("arr", "double *", 8)),
}


def addresses(
    space: pymunk.Space, reading: batch.Buffer, writing: batch.Buffer
) -> tuple[NDArray[np.uint64], NDArray[np.int32], NDArray[np.int32], list[object]]:
    """The addresses of Chipmunk's functions and their data, for `drive.roll`: `engine`, `written` and `read`.

    The last item is the data, to be kept as long as it is used. pymunk's `Space.step` and batch calls use the same.
    """
    data, counters = [], []
    for fields, buffer in ((WRITE, writing), (READ, reading)):
        batched = ffi.new("pmBatchedData *")
        batched.fields, batched.floatArray, batched.intArray = fields.value, buffer._float_arr, buffer._int_arr
        data.append(batched)
        number = ffi.buffer(ffi.addressof(buffer._float_arr, "num"), ffi.sizeof("int"))
        counters.append(np.frombuffer(number, np.int32))
    step, each, write, read = (ffi.addressof(lib, name) for name in FUNCTIONS)
    pointers = (step, each, space._space, write, data[0], read, data[1])
    engine = np.array([int(ffi.cast("uintptr_t", one)) for one in pointers], np.uint64)
    return engine, counters[0], counters[1], data


@cache
def check() -> None:
    """Raise InputError unless pymunk's insides are as they are used here."""
    for problem in (_declared(), _tried()):
        if problem:
            raise InputError(
                f"pymunk {pymunk.version}: {problem}; install one that swarmsim knows: pip install 'pymunk>=7,<8'"
            )


def _declared() -> str:
    """The first declaration in C that is another one, or nothing."""
    try:
        found: dict[str, object] = {name: ffi.typeof(ffi.addressof(lib, name)).cname for name in FUNCTIONS}
        for name in STRUCTS:
            found[name] = tuple((field, one.type.cname, one.offset) for field, one in ffi.typeof(name).fields)
    except (AttributeError, ffi.error) as problem:
        return f"it lacks what the physics calls by address ({problem})"
    differing = [name for name, known in {**FUNCTIONS, **STRUCTS}.items() if found[name] != known]
    return f"{differing[0]} is declared in another way" if differing else ""


def _tried() -> str:
    """What batch calls do otherwise than pymunk's attributes, or nothing."""
    space = pymunk.Space()
    bodies = [pymunk.Body(1.0 + i, 1.0) for i in range(2)]
    for i, body in enumerate(bodies):
        space.add(body)
        body.position, body.angle = (1.0 + i, 2.0 + i), 3.0 + i
        body.velocity, body.angular_velocity = (4.0 + i, 5.0 + i), 6.0 + i
    reading, writing = batch.Buffer(), batch.Buffer()
    batch.get_space_bodies(space, READ, reading)
    moving = np.frombuffer(reading.float_buf()).tolist()
    if moving != [value + i for i in range(2) for value in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]:
        return "its batch call reads bodies in another order"
    push = np.array([[7.0, 8.0, 9.0], [10.0, 11.0, 12.0]])
    writing.set_float_buf(push)
    batch.set_space_bodies(space, WRITE, writing)
    if [(*body.force, body.torque) for body in bodies] != [tuple(row) for row in push.tolist()]:
        return "its batch call writes forces in another order"
    return ""
