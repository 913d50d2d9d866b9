# SPDX-License-Identifier: MIT
from collections import Counter
from pathlib import Path

import pytest
from aiohttp.test_utils import make_mocked_request
from multidict import CIMultiDict

from segway_ecc.deploy.station.web.audit import AuditLog
from segway_ecc.deploy.station.web.authentication import AuthenticationMiddleware
from segway_ecc.deploy.station.web.limits import Limits
from segway_ecc.deploy.station.web.shared import Cause, RefusedRequestError, SharedServices
from segway_ecc.deploy.station.web.site_address import SiteAddress
from tests.deploy.station.web.scripted_station import ScriptedStation

OURS = "127.0.0.1:8700"


@pytest.fixture
def authentication(tmp_path: Path) -> AuthenticationMiddleware:
    shared = SharedServices(ScriptedStation(), AuditLog(tmp_path, lambda: 0), Counter(), Limits(), lambda: 0)
    return AuthenticationMiddleware(SiteAddress("http", 8700), None, shared)


@pytest.mark.parametrize("hosts", [(), (OURS, OURS), (OURS, "evil.example:8700"), ("evil.example:8700", OURS)])
def test_request_without_exactly_one_host_header_is_refused(
    authentication: AuthenticationMiddleware, hosts: tuple[str, ...]
) -> None:
    """A proxy and the station could each believe another of two; newer aiohttp refuses them before we see them."""
    request = make_mocked_request("GET", "/", CIMultiDict([("Host", host) for host in hosts]))
    with pytest.raises(RefusedRequestError) as refused:
        authentication.check(request)
    assert refused.value.cause is Cause.FOREIGN_HOST


def test_request_with_our_host_header_passes(authentication: AuthenticationMiddleware) -> None:
    authentication.check(make_mocked_request("GET", "/", CIMultiDict([("Host", OURS)])))
