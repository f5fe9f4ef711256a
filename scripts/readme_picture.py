"""Make the picture at the top of the README: measured, predicted and their distance at three times of `plop demo`.

python scripts/readme_picture.py demo docs/pictures/demo.jpg
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image

from plop.artifacts.store import Store

WIDTH_PX = 1000
"""Width of a README's column on a wide screen [px]."""


def main(workspace: str, target: str) -> None:
    """Shrink the picture of eval for the first episode."""
    picture = sorted((Store(workspace).find("eval@latest").path / "pictures").glob("*.png"))[0]
    image = Image.open(picture).convert("RGB")
    image = image.resize((WIDTH_PX, round(image.height * WIDTH_PX / image.width)), Image.Resampling.LANCZOS)
    Path(target).parent.mkdir(parents=True, exist_ok=True)
    image.save(target, "JPEG", quality=85, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
