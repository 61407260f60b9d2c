"""Check every link of the built site that stays in it: page and place exist."""

from html.parser import HTMLParser
from pathlib import Path
import sys
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """The links of a page and the places on it."""

    def __init__(self, path):
        super().__init__()
        self.links, self.places = [], set()
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag, attrs):
        """Take note of links, images, scripts and ids."""
        arguments = dict(attrs)
        self.places |= {arguments[name]
                        for name in ('id', 'name') if arguments.get(name)}
        self.links += [arguments[name]
                       for name in ('href', 'src') if arguments.get(name)]


def broken(site):
    """Return a line for each link of a built site that leads nowhere."""
    pages = {path.resolve(): Page(path) for path in site.rglob('*.html')}
    found = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = ((path.parent / unquote(parts.path)).resolve() if parts.path
                      else path)
            place = unquote(parts.fragment)
            if not target.exists():
                found.append(f'{path.relative_to(site)}: no file for {link}')
            elif place and target in pages and place not in pages[target].places:
                found.append(f'{path.relative_to(site)}: no such place: {link}')
    return found


if __name__ == '__main__':
    lines = broken(Path(sys.argv[1]).resolve())
    print('\n'.join(lines) or 'every link leads somewhere')
    sys.exit(bool(lines))
