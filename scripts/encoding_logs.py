#!/usr/bin/env python3
"""The same 200 messages of two topics in three encodings: a folder in, its json.mcap, ros2.mcap and protobuf.mcap out.

    python3 -m venv v && v/bin/pip install mcap==1.6.0 mcap-ros2-support==0.6.0 mcap-protobuf-support==0.6.0
    v/bin/python scripts/encoding_logs.py tests/logs

Every number is the same in all of them to the last bit: what goes into a float32 is rounded to it first. Values that are 0, which
protobuf leaves out, NaN, infinities and lists of changing length are among them.
"""

import json
import math
import struct
import sys
from pathlib import Path

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

START = 1_700_000_000_000_000_000
COUNT = 200

IMU_MSG = """\
# What an inertial sensor says.
std_msgs/Header header
uint8 OK=0
uint8 BAD=1
uint8 status 0      # OK or BAD
Vector3 rate        # rad/s
float32 temperature
float64[9] covariance
bool valid
int16 raw
int64 count
float64[] axes
uint16[<=20] pulses
string label
Named[] states
Vector3[2] pair
float32 last
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: test_msgs/Vector3
float64 x
float64 y
float64 z
================================================================================
MSG: test_msgs/Named
string name
float32 value
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

AIR_MSG = "float64 tas\nuint8[3] flags\nfloat64 alpha\n"


def single(x):
    """The float32 nearest to a number."""
    return struct.unpack("<f", struct.pack("<f", x))[0]


def imu(i):
    """A message of the topic /imu and its log time."""
    stamp = START + i * 20_000_000
    special = {5: math.nan, 6: math.inf, 7: -math.inf, 8: 1e-310, 9: 1e300}
    value = {
        "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "base" + "x" * (i % 5)},
        "status": i % 2,
        "rate": {"x": special.get(i, math.sin(0.1 * i)), "y": 0.0 if i % 3 else -0.25 * i, "z": math.pi * i},
        "temperature": single(20.1 + 0.01 * i) if i % 4 else 0.0,
        "covariance": [single(0.1 * k) if k % 4 == 0 else 0.0 for k in range(9)],
        "valid": i % 7 != 0,
        "raw": -300 + 3 * i,
        "count": i - 100 if i % 2 else (2**53 + 1) * (1 if i % 4 else -1),
        "axes": [0.5 * i + k for k in range(i % 4)],
        "pulses": [1000 + 10 * k + i for k in range(8)],
        "label": "é" * (i % 3),
        "states": [{"name": "n" * (i % 6), "value": single(0.3 * i)}, {"name": "", "value": -1.5}][: 1 + i % 2],
        "pair": [{"x": 1.0 * i, "y": 2.0, "z": 3.0}, {"x": 0.0, "y": -2.0 * i, "z": 0.0}],
        "last": single(-0.7 * i),
    }
    return stamp + (i * 37 % 5) * 1_000_000, value


def air(i):
    """A message of the topic /air and its log time."""
    return START + i * 20_000_000 + 5_000_000, {
        "tas": 100.0 + 0.125 * i,
        "flags": [i % 2, 0, 255],
        "alpha": 0.01 * i - 1.0,
    }


def messages():
    """Topic, log time and content, in the order of the log times."""
    all_messages = [("/imu", *imu(i)) for i in range(COUNT)] + [("/air", *air(i)) for i in range(COUNT)]
    return sorted(all_messages, key=lambda m: m[1])


def write_json(path):
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=20_000)
        writer.start(library="")
        channels = {t: writer.register_channel(t, "json", 0) for t in ("/air", "/imu")}
        for topic, at, value in messages():
            writer.add_message(channels[topic], at, json.dumps(value).encode(), at - 1000)
        writer.finish()


def write_ros2(path):
    with open(path, "wb") as file:
        writer = Ros2Writer(file, chunk_size=20_000)
        schemas = {
            "/imu": writer.register_msgdef("test_msgs/msg/Imu", IMU_MSG),
            "/air": writer.register_msgdef("test_msgs/msg/Air", AIR_MSG),
        }
        for topic, at, value in messages():
            writer.write_message(topic, schemas[topic], value, at, at - 1000)
        writer.finish()


def protobuf_types():
    """The message classes of the two topics."""
    file = descriptor_pb2.FileDescriptorProto(name="test.proto", package="test", syntax="proto3")
    field = descriptor_pb2.FieldDescriptorProto

    def message(name, *fields):
        made = file.message_type.add(name=name)
        for number, (field_name, kind, *more) in enumerate(fields, start=1):
            repeated = "repeated" in more
            one = made.field.add(name=field_name, number=17 * number if "far" in more else number)
            one.label = field.LABEL_REPEATED if repeated else field.LABEL_OPTIONAL
            if isinstance(kind, str):
                one.type = field.TYPE_ENUM if kind == "Status" else field.TYPE_MESSAGE
                one.type_name = ".test." + kind
            else:
                one.type = kind
            if "unpacked" in more:
                one.options.packed = False

    status = file.enum_type.add(name="Status")
    status.value.add(name="OK", number=0)
    status.value.add(name="BAD", number=1)
    message("Stamp", ("sec", field.TYPE_INT64), ("nanosec", field.TYPE_UINT32))
    message("Header", ("stamp", "Stamp"), ("frame_id", field.TYPE_STRING))
    message("Vector3", ("x", field.TYPE_DOUBLE), ("y", field.TYPE_DOUBLE), ("z", field.TYPE_DOUBLE))
    message("Named", ("name", field.TYPE_STRING), ("value", field.TYPE_FLOAT))
    message(
        "Imu",
        ("header", "Header"),
        ("status", "Status"),
        ("rate", "Vector3"),
        ("temperature", field.TYPE_FLOAT),
        ("covariance", field.TYPE_DOUBLE, "repeated"),
        ("valid", field.TYPE_BOOL),
        ("raw", field.TYPE_SINT32),
        ("count", field.TYPE_INT64),
        ("axes", field.TYPE_DOUBLE, "repeated", "unpacked"),
        ("pulses", field.TYPE_UINT32, "repeated", "far"),
        ("label", field.TYPE_STRING),
        ("states", "Named", "repeated"),
        ("pair", "Vector3", "repeated"),
        ("last", field.TYPE_FLOAT, "far"),
    )
    message("Air", ("tas", field.TYPE_DOUBLE), ("flags", field.TYPE_FIXED32, "repeated"), ("alpha", field.TYPE_DOUBLE))
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    found = {t: pool.FindMessageTypeByName(n) for t, n in (("/imu", "test.Imu"), ("/air", "test.Air"))}
    return {topic: message_factory.GetMessageClass(descriptor) for topic, descriptor in found.items()}


def write_protobuf(path):
    types = protobuf_types()
    with open(path, "wb") as file:
        writer = ProtobufWriter(file, chunk_size=20_000)
        for topic, at, value in messages():
            writer.write_message(topic, types[topic](**value), at, at - 1000)
        writer.finish()


def main():
    folder = Path(sys.argv[1])
    write_json(folder / "json.mcap")
    write_ros2(folder / "ros2.mcap")
    write_protobuf(folder / "protobuf.mcap")


main()
