"""Run again what the pages show, and keep what it prints and draws.

python docs/record.py                       the commands of every page and of README.md, then the examples: hours
python docs/record.py benchmarks.md         the commands of one page
python docs/record.py benchmarks.md --only limit --only memory
python docs/record.py examples              all scripts of examples/, for the gallery
python docs/record.py membrane.py           one of them

A command is the line that begins with "$ " in a block of the kind "console"; it runs in a shell, in a folder that has
nothing but tests/.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_extensions"))
from gallery import EXAMPLES, digest, kept_name  # noqa: E402

BLOCK = re.compile(r"^```console\n\$ (?P<command>.+)\n(?P<output>(?:.*\n)*?)```$", re.MULTILINE)


def printed(command, folder):
    """What `command` prints in that folder."""
    ran = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=False)
    if not ran.stdout:
        raise SystemExit(f"{command} printed nothing, and ended with {ran.returncode}")
    return "".join(f"{line.rstrip()}\n" for line in ran.stdout.splitlines())


def recorded(text, words=()):
    """`text` with the outputs of its commands, of those with one of the `words` in them where there are words."""

    def again(block):
        if words and not any(word in block["command"] for word in words):
            return block[0]
        print("$", block["command"], flush=True)
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "tests").symlink_to(DOCS.parent / "tests")
            output = printed(["bash", "-c", block["command"]], folder)
        return f"```console\n$ {block['command']}\n{output}```"

    return BLOCK.sub(again, text)


def record_example(script):
    print(script.name, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        output = printed([sys.executable, str(DOCS / "lesson.py"), str(script)], folder)
        for picture in Path(folder).glob("*.png"):
            name = kept_name(script, picture.name)
            small = Image.open(picture).convert("RGB").quantize(256, dither=Image.Dither.NONE)  # a third of the bytes
            small.save(EXAMPLES / "figures" / name, optimize=True)
    (EXAMPLES / "output" / f"{script.stem}.txt").write_text(digest(script) + output, encoding="utf-8")


def main():
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("what", nargs="*")
    asked.add_argument("--only", action="append", default=[])
    asked = asked.parse_args()
    pages = [DOCS / name for name in asked.what if name.endswith(".md")]
    scripts = [EXAMPLES / name for name in asked.what if name.endswith(".py")]
    if not asked.what:
        pages = [*(page for page in sorted(DOCS.glob("*.md"))), DOCS.parent / "README.md"]
    if not asked.what or "examples" in asked.what:
        scripts = sorted(EXAMPLES.glob("*.py"))
    for page in pages:
        page.write_text(recorded(page.read_text(encoding="utf-8"), asked.only), encoding="utf-8")
    for folder in ("figures", "output"):
        (EXAMPLES / folder).mkdir(exist_ok=True)
    for script in scripts:
        record_example(script)


if __name__ == "__main__":
    main()
