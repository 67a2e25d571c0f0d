"""Devices in a domain: `composed` puts what they say together with what the domain, its fault base or its cell says itself.

A device is text with parameters. It is filled in first and read then, by the readers that read the domain's own files. Every part
of the tree knows the file that it comes from, so an error is told where it stands: in the file of the device.
"""

from cellwright.kb.loader.uses.binding import Use, uses_in
from cellwright.kb.loader.uses.composing import composed, composed_beside
from cellwright.kb.loader.uses.devices import Device, all_devices, available, device_called, read_device

__all__ = [
    "Device",
    "Use",
    "all_devices",
    "available",
    "composed",
    "composed_beside",
    "device_called",
    "read_device",
    "uses_in",
]
