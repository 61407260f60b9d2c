"""Draw the pictures of the pages: run each page's code and keep what it shows."""

from pathlib import Path
import re
import sys
from tempfile import TemporaryDirectory

from PIL import Image

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS.parent / 'test' / 'helpers')]
WIDTH = 1000
COLORS = 64
SHOWN = re.compile(r'\]\(pictures/([\w.-]+)\)')


def main() -> None:
    """Draw the pictures of the pages; `python docs/pictures.py PAGE` those of one."""
    from documents import work_through  # found by the path above
    for page in [DOCS / name for name in sys.argv[1:]] or sorted(DOCS.glob('*.md')):
        names = SHOWN.findall(page.read_text(encoding='utf-8'))
        if not names:
            continue
        with TemporaryDirectory() as folder:
            work_through(page, Path(folder))
            for name in filter(lambda name: (Path(folder) / name).exists(), names):
                keep(Path(folder) / name, DOCS / 'pictures' / name)


def keep(drawn: Path, path: Path) -> None:
    """Copy a picture in few colors, no wider than a page."""
    with Image.open(drawn) as picture:
        picture.thumbnail((WIDTH, 2 * WIDTH))
        picture.convert('RGB').quantize(COLORS).save(path, optimize=True)
    print(f'docs/pictures/{path.name}: {path.stat().st_size // 1000} kB')


if __name__ == '__main__':
    main()
