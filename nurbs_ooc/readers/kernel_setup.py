"""Settings of the kernel that hold for every file: silence, millimetres."""

from __future__ import annotations

from typing import Any

from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.STEPCAFControl import STEPCAFControl_Controller
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDocStd import TDocStd_Document


def prepare_kernel() -> None:
    """Remove the kernel's console printers and ask for millimetres; call once in a process."""
    messenger = Message.DefaultMessenger_s()
    for printer in list(messenger.Printers()):
        messenger.RemovePrinter(printer)
    STEPCAFControl_Controller.Init_s()
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")


def new_document() -> Any:
    """An empty document for products, shapes and colours."""
    return TDocStd_Document(TCollection_ExtendedString("XmlXCAF"))
