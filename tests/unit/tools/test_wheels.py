"""Which wheel an aarch64 computer takes, and what is said when there is none."""

from typing import Any

from tools.wheels import Offer, offered, table

PYTHON = (3, 11)


def package(name: str, *wheels: str, version: str = "1.0", **more: str) -> dict[str, Any]:
    """An entry of a pylock.toml; `wheels` are the ends of their names."""
    addresses = [f"https://somewhere/a/{name}-{version}-{wheel}.whl" for wheel in wheels]
    return {"name": name, "version": version, "wheels": [{"url": at} for at in addresses], **more}


def test_a_wheel_of_another_processor_python_or_c_library_is_none() -> None:
    others = ("cp311-cp311-manylinux_2_28_x86_64", "cp312-cp312-manylinux_2_28_aarch64")
    libraries = ("cp311-cp311-musllinux_1_2_aarch64", "cp311-cp311-manylinux_2_39_aarch64")
    assert offered(package("it", *others, *libraries), PYTHON) is None
    assert offered({"name": "it", "version": "1.0"}, PYTHON) is None


def test_the_oldest_c_library_that_is_promised_counts() -> None:
    both = package("it", "cp311-cp311-manylinux_2_17_aarch64.manylinux_2_28_aarch64")
    assert offered(both, PYTHON) == Offer("1.0", pure=False, glibc=(2, 17))
    two = package("it", "cp311-cp311-manylinux_2_28_aarch64", "cp311-cp311-manylinux2014_aarch64")
    assert offered(two, PYTHON) == Offer("1.0", pure=False, glibc=(2, 17))


def test_a_stable_interface_serves_later_pythons() -> None:
    stable = package("it", "cp39-abi3-manylinux_2_28_aarch64")
    assert offered(stable, (3, 13)) == Offer("1.0", pure=False, glibc=(2, 28))


def test_pure_python_serves_all() -> None:
    assert offered(package("it", "py3-none-any"), PYTHON) == Offer("1.0", pure=True, glibc=None)


def test_the_table_takes_each_python_s_own_version_and_names_what_is_missing() -> None:
    old, new = "python_full_version == '3.11.*'", "python_full_version >= '3.12'"
    built = "cp311-cp311-manylinux_2_28_aarch64"
    text, missing = table(
        [
            package("numbers", built, version="1.0", marker=old),
            package("numbers", "cp312-cp312-manylinux_2_28_aarch64", version="2.0", marker=new),
            package("plain", "py3-none-any"),
            package("winner", "cp311-cp311-win_amd64", marker="sys_platform == 'win32'"),
        ]
    )
    assert "| numbers | 1.0, glibc 2.28 | 2.0, glibc 2.28 | 2.0, **none** |" in text
    assert "For any processor (1): plain." in text
    assert missing == ["numbers 2.0 for Python 3.13"]
