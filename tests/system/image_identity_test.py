#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Host name and machine-id of the disk image's box, from what boards say about themselves."""

import os
import pathlib
import subprocess
import tempfile

SCRIPT = pathlib.Path(__file__).parents[2] / "deploy" / "image.d" / "root" / "etc" / "initramfs-tools" / "scripts" / "init-bottom" / "throwcal"
DMI, TREE = "class/dmi/id/", "firmware/devicetree/base/serial-number"
UUID = {DMI + "product_uuid": "4c4c4544-0042-3510-8052-b4c04f4e4d31\n"}
CARDS = {
    "pci0000:00/0000:00:1f.6/net/enp0s31f6": "52:54:00:AA:bb:cc",
    "pci0000:00/0000:00:02.0/net/eth0": "52:54:00:12:34:56",
    "virtual/net/docker0": "02:42:00:00:00:01",
}


def who(files: dict[str, str], cards: dict[str, str] = CARDS) -> tuple[str, str]:
    with tempfile.TemporaryDirectory() as folder:
        sys = pathlib.Path(folder)
        for name, text in files.items():
            (sys / name).parent.mkdir(parents=True, exist_ok=True)
            (sys / name).write_bytes(text.encode("latin-1"))
        (sys / "class" / "net").mkdir(parents=True, exist_ok=True)
        for place, address in cards.items():
            card = sys / "devices" / place
            card.mkdir(parents=True)
            for name, text in {"address": address, "type": "1", "addr_assign_type": "0"}.items():
                (card / name).write_text(text + "\n")
            if "virtual" not in place:
                (card / "device").symlink_to(card.parent.parent)
            (sys / "class" / "net" / card.name).symlink_to(card)
        said = subprocess.run(["sh", SCRIPT], env={**os.environ, "sys": folder}, stdout=subprocess.PIPE, check=True, text=True).stdout.split()
        assert len(said) == 2 and len(said[1]) == 32 and set(said[1]) <= set("0123456789abcdef"), said
        return said[0], said[1]


def main() -> None:
    serials = {"AB-1234\n": "ab-1234", "To.Be 42/7": "to-be-42-7", " 007 \n": "007", "\xff\xfeX1\n": "x1", "s" + "1" * 100: "s" + "1" * 47}
    for serial, name in serials.items():
        assert who({DMI + "product_serial": serial})[0] == "throwcal-" + name, (serial, who({DMI + "product_serial": serial}))
    no_serials = [
        "To be filled by O.E.M.",
        "Default string",
        "None",
        "0",
        "00000000",
        "System Serial Number",
        "Not Specified",
        "N/A",
        "",
        "\n",
        "xxxx",
        "123456789",
    ]
    for serial in no_serials:
        assert who({DMI + "product_serial": serial + "\n"})[0] == "throwcal-123456", serial  # of the first card
    assert who({DMI + "product_serial": "None\n", DMI + "board_serial": "B7\n"})[0] == "throwcal-b7"
    assert who({TREE: "10000000abcdef01\0"})[0] == "throwcal-10000000abcdef01"
    assert who({}, {})[0] == "throwcal"

    assert who({**UUID, DMI + "product_serial": "A1"}) == who({**UUID, DMI + "product_serial": "A1"}, {}), "a card more or less"
    alike = {DMI + "product_uuid": "03000200-0400-0500-0006-000700080009\n", DMI + "product_serial": "Default string\n"}
    ids = [
        who(UUID)[1],
        who(alike)[1],
        who(alike, {"pci0/net/eth0": "52:54:00:99:99:99"})[1],
        who({TREE: "10000000abcdef01\0"})[1],
        who({}, {})[1],
        who({}, {})[1],
    ]
    assert len(set(ids)) == len(ids), ids
    print(f"{len(serials) + len(no_serials)} serials, {len(ids)} machine-ids", flush=True)


if __name__ == "__main__":
    main()
