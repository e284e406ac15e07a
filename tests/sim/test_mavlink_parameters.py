import asyncio
import struct

import pytest
from mavlink_cases import Rig
from pymavlink.dialects.v20 import development as dialect

from flightapp.inputs import BadInputError
from sim.mavlink.parameters import override, standard_parameters
from sim.px4.parameters import Parameters

INT32, REAL32 = 6, 9


def as_int(value):
    return struct.unpack("<i", struct.pack("<f", value))[0]


def from_int(value):
    return struct.unpack("<f", struct.pack("<i", value))[0]


async def read(client, name, patience=1.0):
    answer = asyncio.ensure_future(client.wait("PARAM_VALUE", lambda m: m.param_id == name, patience))
    await asyncio.sleep(0)
    client.send(dialect.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    return await answer


async def write(client, name, value, kind):
    answer = asyncio.ensure_future(client.wait("PARAM_VALUE", lambda m: m.param_id == name, 0.3))
    await asyncio.sleep(0)
    client.send(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, kind))
    return await answer


async def test_values_are_read_with_their_types():
    async with Rig() as rig:
        told = await read(rig.client, "MPC_TKO_SPEED")
        assert (told.param_type, told.param_value) == (REAL32, pytest.approx(1.5))
        told = await read(rig.client, "EKF2_EV_CTRL")
        assert (told.param_type, as_int(told.param_value)) == (INT32, 15)


async def test_values_are_written_and_act():
    async with Rig() as rig:
        client = rig.client
        told = await write(client, "MIS_TAKEOFF_ALT", 1.25, REAL32)
        assert told.param_value == 1.25
        assert rig.px4.parameters["MIS_TAKEOFF_ALT"] == 1.25
        told = await write(client, "CBRK_USB_CHK", from_int(197848), INT32)
        assert as_int(told.param_value) == rig.px4.parameters["CBRK_USB_CHK"] == 197848


async def test_a_wrong_type_and_an_unknown_name_get_no_value():
    async with Rig() as rig:
        client = rig.client
        with pytest.raises(TimeoutError):
            await write(client, "MIS_TAKEOFF_ALT", from_int(3), INT32)
        assert rig.px4.parameters["MIS_TAKEOFF_ALT"] == 2.5
        with pytest.raises(TimeoutError):
            await write(client, "NO_SUCH_THING", 1.0, REAL32)
        with pytest.raises(TimeoutError):
            await read(client, "NO_SUCH_THING", 0.2)


async def test_the_whole_list():
    async with Rig() as rig:
        client = rig.client
        client.send(dialect.MAVLink_param_request_list_message(1, 1))
        last = await client.wait("PARAM_VALUE", lambda m: m.param_index == m.param_count - 1)
        told = client.named("PARAM_VALUE")
        assert told[0].param_id == "_HASH_CHECK"
        assert [message.param_index for message in told[1:]] == list(range(last.param_count))
        assert {message.param_id for message in told[1:]} == set(rig.px4.parameters)
        assert last.param_count > 100
        by_index = asyncio.ensure_future(client.wait("PARAM_VALUE"))
        await asyncio.sleep(0)
        client.send(dialect.MAVLink_param_request_read_message(1, 1, b"", 3))
        assert (await by_index).param_id == told[4].param_id


async def test_hidden_parameters_are_not_there():
    async with Rig() as rig:
        rig.endpoint.faults.apply("missing", "MPC_THR_HOVER, THR_MDL_FAC")
        with pytest.raises(TimeoutError):
            await read(rig.client, "THR_MDL_FAC", 0.2)
        assert (await read(rig.client, "MPC_TKO_SPEED")).param_count == len(rig.px4.parameters) - 2


async def test_requests_to_others_are_ignored():
    async with Rig() as rig:
        rig.client.send(dialect.MAVLink_param_request_list_message(2, 1))
        assert await rig.client.nothing("PARAM_VALUE", 0.15)


def test_the_table_is_px4s():
    table = standard_parameters()
    assert all(len(name) <= 16 for name in table)
    assert {type(value) for value in table.values()} == {int, float}
    assert table["SYS_HAS_GPS"] == 0  # indoors


def test_values_can_be_overridden_by_name():
    parameters = Parameters(standard_parameters())
    override(parameters, ["COM_OF_LOSS_T=1.5", "EKF2_EV_CTRL = 0"])
    assert (parameters["COM_OF_LOSS_T"], parameters["EKF2_EV_CTRL"]) == (1.5, 0)
    override(parameters, ["MPC_THR_HOVER=0.1"])
    assert parameters["MPC_THR_HOVER"] == struct.unpack("<f", struct.pack("<f", 0.1))[0]


@pytest.mark.parametrize(
    "assignment, complaint",
    [
        ("EKF2_EV_CTRL", "give NAME=VALUE"),
        ("EKF2_EV_CTLR=1", "did you mean EKF2_EV_CTRL"),
        ("EKF2_EV_CTRL=1.5", "is not an integer"),
        ("COM_OF_LOSS_T=soon", "is not a number"),
    ],
)
def test_bad_overrides_are_named(assignment, complaint):
    with pytest.raises(BadInputError, match=complaint):
        override(Parameters(standard_parameters()), [assignment])
