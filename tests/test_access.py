"""Who may ask the servers of ``live`` and ``monitor``."""

import re

import pytest

from glint_aoa.access import Access
from glint_aoa.errors import InputError

TOKEN = "abcdefghij-_0123456789"


def test_localhost_needs_no_token_and_all_else_has_one():
    assert Access.of("127.0.0.1", 5007, None).token is None
    assert Access.of("localhost", 5007, None).token is None
    assert Access.of("::1", 5007, None).token is None
    made = {Access.of(address, 5007, None).token for address in ("0.0.0.0", "10.0.0.5", "::")}
    assert len(made) == 3
    assert all(len(token) >= 32 for token in made)
    assert Access.of("127.0.0.1", 5007, TOKEN).token == TOKEN


@pytest.mark.parametrize(
    ("address", "host", "known"),
    [
        ("127.0.0.1", "127.0.0.1:5007", True),
        ("127.0.0.1", "LOCALHOST:5007", True),
        ("127.0.0.1", "[::1]:5007", True),
        ("127.0.0.1", "localhost", False),
        ("127.0.0.1", "localhost:80", False),
        ("127.0.0.1", "evil.example:5007", False),
        ("127.0.0.1", "localhost.evil.example:5007", False),
        ("127.0.0.1", "10.0.0.5:5007", False),
        ("127.0.0.1", "evil@localhost:5007", False),
        ("127.0.0.1", "localhost:x", False),
        ("127.0.0.1", "", False),
        ("10.0.0.5", "10.0.0.5:5007", True),
        ("10.0.0.5", "localhost:5007", False),
        ("10.0.0.5", "evil.example:5007", False),
        ("0.0.0.0", "192.168.1.7:5007", True),
        ("0.0.0.0", "localhost:5007", True),
        ("0.0.0.0", "tunnel-pc:5007", True),
        ("0.0.0.0", "evil.example:5007", False),
    ],
)
def test_only_the_server_s_own_names_are_known(address, host, known, monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "Tunnel-PC")
    monkeypatch.setattr("socket.getfqdn", lambda: "tunnel-pc.lab")
    assert Access.of(address, 5007, TOKEN).knows_host(host) is known


@pytest.mark.parametrize(
    ("origin", "known"),
    [
        ("http://127.0.0.1:5007", True),
        ("https://127.0.0.1:5007", False),
        ("http://127.0.0.1:5008", False),
        ("http://localhost:5007", False),
        ("null", False),
    ],
)
def test_only_the_page_itself_may_ask(origin, known):
    access = Access.of("127.0.0.1", 5007, None)
    assert access.knows_origin(origin, "127.0.0.1:5007") is known


def test_the_token_must_be_right():
    access = Access.of("0.0.0.0", 5007, TOKEN)
    assert access.knows_token(TOKEN)
    for wrong in (None, "", TOKEN[:-1], TOKEN + "x", "é"):
        assert not access.knows_token(wrong)
    assert Access.of("127.0.0.1", 5007, None).knows_token(None)


def test_the_address_of_the_page_has_the_token(monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "tunnel-pc")
    assert Access.of("127.0.0.1", 5007, None).url == "http://127.0.0.1:5007/"
    assert Access.of("::1", 5007, None).url == "http://[::1]:5007/"
    assert Access.of("0.0.0.0", 5007, TOKEN).url == f"http://tunnel-pc:5007/?token={TOKEN}"


@pytest.mark.parametrize("address", ["everywhere", "tunnel-pc", "", "300.1.1.1"])
def test_what_is_no_address_is_refused(address):
    sentence = f"--listen is {address}; give an IP address of this machine, or 0.0.0.0 for all"
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        Access.of(address, 5007, None)


@pytest.mark.parametrize(
    "token", ["short", "", "with a space in the token", "ünsafe-in-an-address"]
)
def test_a_token_that_can_be_guessed_or_not_be_written_is_refused(token):
    sentence = "--token must be 16 or more letters, digits, - and _; leave it out to have one made"
    with pytest.raises(InputError, match=f"^{re.escape(sentence)}$"):
        Access.of("127.0.0.1", 5007, token)
