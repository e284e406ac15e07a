"""What is seen and mapped, as protobuf."""

import dataclasses
import math

import numpy as np
import pytest
import recorded_messages as sample
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from flightapp.messages import GateMap, Sightings
from flightapp.recording.nested import NESTED

MAKE = {GateMap: sample.gate_map, Sightings: sample.sightings}
FLAT = {"alternative": ("alternative_position", "alternative_orientation")}


def parsed(message):
    nested = NESTED[type(message)]
    file = descriptor_pb2.FileDescriptorSet.FromString(nested.schema).file[0]
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    kind = pool.FindMessageTypeByName(f"flightapp.{type(message).__name__}")
    return message_factory.GetMessageClass(kind).FromString(nested.encode(message))


def agrees(seen, message):
    """Whether what others read, ``seen``, holds every field of ``message``."""
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if field.name == "alternative":
            assert [len(getattr(seen, name)) for name in FLAT[field.name]] == ([0, 0] if value is None else [3, 4])
            for name, part in zip(FLAT[field.name], value or (), strict=False):
                assert np.array_equal(getattr(seen, name), part)
        elif isinstance(value, tuple):
            assert len(getattr(seen, field.name)) == len(value)
            for inner, part in zip(getattr(seen, field.name), value, strict=True):
                agrees(inner, part)
        elif dataclasses.is_dataclass(value):
            agrees(getattr(seen, field.name), value)
        else:
            assert np.array_equal(getattr(seen, field.name), np.ravel(value) if np.ndim(value) else value)


@pytest.mark.parametrize("kind", MAKE)
def test_nested_messages_are_protobuf_that_others_can_read(kind):
    message = MAKE[kind](np.random.default_rng(2), 1.25)
    agrees(parsed(message), message)


@pytest.mark.parametrize("kind", MAKE)
def test_a_message_of_nothing_comes_back(kind):
    rng = np.random.default_rng(3)
    empty = dataclasses.replace(MAKE[kind](rng, 0.0), gates=())
    if kind is Sightings:
        empty = dataclasses.replace(empty, markers=())
    back = NESTED[kind].decode(NESTED[kind].encode(empty))
    assert (back.stamp, back.gates) == (0.0, ())


def test_numbers_that_are_not_finite_survive():
    rng = np.random.default_rng(4)
    gate = dataclasses.replace(sample.gate(rng, 1), position=np.array([math.nan, math.inf, -math.inf]))
    back = NESTED[GateMap].decode(NESTED[GateMap].encode(dataclasses.replace(sample.gate_map(rng, 1.0), gates=(gate,))))
    assert np.array_equal(back.gates[0].position, gate.position, equal_nan=True)
    assert back.gates[0].last_seen == -math.inf


@pytest.mark.parametrize("kind", MAKE)
def test_a_message_that_was_cut_is_refused(kind):
    whole = NESTED[kind].encode(MAKE[kind](np.random.default_rng(5), 1.0))
    with pytest.raises((DecodeError, ValueError)):
        NESTED[kind].decode(whole[:-5])
