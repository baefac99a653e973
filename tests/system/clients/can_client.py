#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The poses of a box on CAN (unit 0 on can0), once each. Needs: pip install python-can cantools."""
import can, cantools

box, poses = cantools.database.load_file("throwcal.dbc"), {}
with can.Bus("can0", interface="socketcan", can_filters=[{"can_id": 0x680, "can_mask": 0x7E0}]) as bus:
    for frame in bus:
        name = box.get_message_by_frame_id(frame.arbitration_id).name
        if name in poses:
            break
        if name.startswith("Camera"):
            poses[name] = box.decode_message(frame.arbitration_id, frame.data)
print(*poses.items(), sep="\n")
