"""Pages that start nodes show what comes out."""

from documents import PAGES, path_in_checkout, starts_nodes, work_through
import pytest

pytest.importorskip('rclpy')


@pytest.mark.timeout(900)  # a page may start two dozen processes
@pytest.mark.parametrize('page', [page for page in PAGES if starts_nodes(page)],
                         ids=path_in_checkout)
def test_code_on_a_page_prints_the_output_that_the_page_shows(page, tmp_path):
    work_through(page, tmp_path)
