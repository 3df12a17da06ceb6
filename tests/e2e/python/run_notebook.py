"""Runs the blocks of a notebook in Markdown, one after the other, in a folder where their pictures are left:
run_notebook.py FILE FOLDER."""

import os
import re
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
blocks = re.findall(r"^```python\n(.*?)^```", Path(sys.argv[1]).read_text(), flags=re.S | re.M)
pictures = set(re.findall(r"!\[[^]]*\]\(([^)]+)\)", Path(sys.argv[1]).read_text()))
os.chdir(sys.argv[2])
names: dict = {}
for number, block in enumerate(blocks):
    assert len(block.strip().splitlines()) < 10, f"block {number} has ten lines or more"
    exec(compile(block, f"block {number}", "exec"), names)
missing = [name for name in pictures if not Path(name).stat().st_size]
assert blocks and pictures and not missing
print(f"{len(blocks)} blocks, {len(pictures)} pictures")
