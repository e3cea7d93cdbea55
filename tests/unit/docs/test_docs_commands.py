"""docs/commands.md: what `rmr doctor` looks for."""

import pytest
from doc_pages import codes, page, table

from rmr_deploy.doctor import checks

PAGE = page("commands")


@pytest.mark.real  # it tries a port
def test_the_page_names_all_that_doctor_looks_for():
    rows = table(PAGE, "`rmr doctor`", "looks for", "wanted by")
    assert [codes(row[0])[0] for row in rows] == [each.name for each in checks()]
