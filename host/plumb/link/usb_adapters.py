"""USB adapters that plumb knows by vendor and product: what they are, and the driver that Linux has for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["uart", "can", "slcan"]


@dataclass(frozen=True)
class UsbAdapter:
    """An adapter. kind: uart a serial port to a board, can a network interface, slcan a CAN adapter behind a serial
    port. module: the kernel module that drives it."""

    name: str
    kind: Kind
    module: str


def _uart(name: str, module: str) -> UsbAdapter:
    return UsbAdapter(name, "uart", module)


ADAPTERS = {
    (0x0403, 0x6001): _uart("FT232R", "ftdi_sio"),
    (0x0403, 0x6010): _uart("FT2232", "ftdi_sio"),
    (0x0403, 0x6011): _uart("FT4232", "ftdi_sio"),
    (0x0403, 0x6014): _uart("FT232H", "ftdi_sio"),
    (0x0403, 0x6015): _uart("FT230X", "ftdi_sio"),
    (0x067B, 0x2303): _uart("PL2303", "pl2303"),
    (0x067B, 0x23A3): _uart("PL2303GC", "pl2303"),
    (0x10C4, 0xEA60): _uart("CP2102", "cp210x"),
    (0x10C4, 0xEA70): _uart("CP2105", "cp210x"),
    (0x10C4, 0xEA71): _uart("CP2108", "cp210x"),
    (0x1A86, 0x5523): _uart("CH341", "ch341"),
    (0x1A86, 0x7523): _uart("CH340", "ch341"),
    (0x1A86, 0x55D3): _uart("CH343", "cdc_acm"),
    (0x1A86, 0x55D4): _uart("CH9102", "cdc_acm"),
    (0x0483, 0x374B): _uart("ST-Link V2-1", "cdc_acm"),
    (0x0483, 0x374E): _uart("ST-Link V3", "cdc_acm"),
    (0x0483, 0x3753): _uart("ST-Link V3", "cdc_acm"),
    (0x0D28, 0x0204): _uart("CMSIS-DAP probe", "cdc_acm"),
    (0x2E8A, 0x000C): _uart("Raspberry Pi debug probe", "cdc_acm"),
    (0x16D0, 0x117E): UsbAdapter("CANable", "slcan", "cdc_acm"),
    (0xAD50, 0x60C4): UsbAdapter("CANable", "slcan", "cdc_acm"),
    (0x1D50, 0x606F): UsbAdapter("candleLight", "can", "gs_usb"),
    (0x1209, 0x2323): UsbAdapter("candleLight", "can", "gs_usb"),
    (0x0C72, 0x000C): UsbAdapter("PCAN-USB", "can", "peak_usb"),
    (0x0C72, 0x000D): UsbAdapter("PCAN-USB Pro", "can", "peak_usb"),
    (0x0C72, 0x0012): UsbAdapter("PCAN-USB FD", "can", "peak_usb"),
}
"""(vendor, product) -> the adapter."""


def known(vendor: int | None, product: int | None) -> UsbAdapter | None:
    return ADAPTERS.get((vendor, product)) if vendor is not None and product is not None else None
