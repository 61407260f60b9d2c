"""Pages that start nodes show what comes out."""

from documents import PAGES, path_in_checkout, starts_nodes, work_through
import pytest

pytest.importorskip('rclpy')


@pytest.mark.timeout(900)  # a page may start two dozen processes
@pytest.mark.parametrize('page', [page for page in PAGES if starts_nodes(page)], ids=named)
def test_what_a_page_shows_is_what_comes_out(page, tmp_path):
    work_through(page, tmp_path)
