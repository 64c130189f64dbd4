"""What two independent readers find in an MCAP recording of a ROS 2 camera, as JSON: `mcap-ros2-support`, and `rosbags`.

    ros_recording.py FILE.mcap
"""
import json
import sys
from pathlib import Path

from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


def figures(topic, stamp_ns, message):
    found = {"topic": topic, "stamp_ns": stamp_ns, "frame_id": message.header.frame_id,
             "header_ns": message.header.stamp.sec * 10**9 + message.header.stamp.nanosec,
             "size": [message.width, message.height]}
    if hasattr(message, "encoding"):
        found |= {"encoding": message.encoding, "step": message.step,
                  "data": bytes(message.data).hex()}
    else:
        found |= {"model": message.distortion_model, "d": list(message.d), "k": list(message.k), "p": list(message.p)}
    return found


path = sys.argv[1]
first = [figures(m.channel.topic, m.log_time_ns, m.ros_msg) for m in read_ros2_messages(path)]
with AnyReader([Path(path)], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
    second = [figures(connection.topic, stamp, reader.deserialize(data, connection.msgtype))
              for connection, stamp, data in reader.messages()]
print(json.dumps({"mcap-ros2-support": first, "rosbags": second}))
