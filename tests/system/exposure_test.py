#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The unit as systemd judges it: understood without a warning, and exposed no more than 1.5."""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

MOST = 1.5

if not shutil.which("systemd-analyze"):
    print("skipped: needs systemd-analyze")
    sys.exit(77)
unit = pathlib.Path(sys.argv[sys.argv.index("--source") + 1]) / "deploy" / "debian" / "throwcald.service"
with tempfile.TemporaryDirectory() as folder:
    # Here is no /usr/bin/throwcald and no manual page of it.
    copy = pathlib.Path(folder) / unit.name
    copy.write_text(re.sub(r"(?m)^(ExecStart=)\S+", r"\1/bin/true", unit.read_text()))
    said = subprocess.run(["systemd-analyze", "verify", "--man=no", copy], capture_output=True, text=True)
    assert said.returncode == 0 and unit.name not in said.stderr, said.stderr
judged = subprocess.run(["systemd-analyze", "security", "--offline=true", "--no-pager", unit], capture_output=True, text=True, check=True).stdout
print("\n".join(line for line in judged.splitlines() if not line.startswith("✓")))
exposure = float(re.search(r"Overall exposure level for throwcald.service: ([0-9.]+)", judged)[1])
assert exposure <= MOST, f"exposure {exposure}, at most {MOST}"
