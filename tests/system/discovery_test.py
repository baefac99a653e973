#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The files by which avahi or systemd-resolved announce the box: well-formed, and both say the same."""

import configparser
import pathlib
import sys
import xml.etree.ElementTree

deploy = pathlib.Path(sys.argv[sys.argv.index("--source") + 1]) / "deploy"
group = xml.etree.ElementTree.parse(deploy / "throwcal.service").getroot()
assert group.tag == "service-group" and group.find("name").text == "throwcal on %h", group
avahi = {service.find("type").text: int(service.find("port").text) for service in group.findall("service")}
resolved = {}
for file in sorted(deploy.glob("*.dnssd")):
    said = configparser.ConfigParser(interpolation=None)
    said.read(file)
    assert set(said["Service"]) == {"name", "type", "port"}, file
    resolved[said["Service"]["type"]] = int(said["Service"]["port"])
assert avahi == resolved == {"_throwcal._tcp": 7710, "_http._tcp": 8080}, (avahi, resolved)
print("announced:", avahi)
