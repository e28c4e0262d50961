"""The address that a viewer prints can be opened."""

import ipaddress
import socket

import pytest

from vehicle_iface_viewer import addresses
from vehicle_iface_viewer.addresses import find_reachable_host, format_url


@pytest.mark.parametrize("host", ["127.0.0.1", "192.0.2.1", "::1", "localhost", "no such name"])
def test_a_host_that_is_no_wildcard_is_printed_as_given(host: str) -> None:
    assert find_reachable_host(host) == host


@pytest.mark.parametrize("host", ["0.0.0.0", "0", "::"])
def test_a_wildcard_is_printed_as_an_address_of_this_machine(host: str) -> None:
    found = ipaddress.ip_address(find_reachable_host(host))
    assert not found.is_unspecified
    family = socket.AF_INET if found.version == 4 else socket.AF_INET6
    with socket.socket(family) as own:
        own.bind((str(found), 0))  # the kernel takes only an address of this machine


def test_without_a_route_a_wildcard_is_the_first_interface_beside_loopback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(addresses, "_find_route_address", lambda _: None)
    monkeypatch.setattr(addresses, "_list_interface_addresses", lambda: iter(["127.0.0.1", "192.0.2.7", "192.0.2.8"]))
    assert find_reachable_host("0.0.0.0") == "192.0.2.7"
    monkeypatch.setattr(addresses, "_list_interface_addresses", lambda: iter(["127.0.0.1"]))
    assert find_reachable_host("0.0.0.0") == "127.0.0.1"


def test_the_interfaces_of_this_machine_include_loopback() -> None:
    assert "127.0.0.1" in addresses._list_interface_addresses()


def test_a_url_has_brackets_around_ipv6_and_a_quoted_token() -> None:
    assert format_url("::1", 8080) == "http://[::1]:8080/"
    assert format_url("car.local", 80, "a+b/c=&%") == "http://car.local:80/?token=a%2Bb%2Fc%3D%26%25"
