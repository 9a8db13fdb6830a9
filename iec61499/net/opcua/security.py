"""Certificates of OPC UA applications."""

from __future__ import annotations

from typing import Any

from cryptography import x509


def application_uri(certificate: Any) -> str:
    """The URI of the application that a certificate names; "" for none (OPC UA part 6, 6.2.2)."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    found = names.get_values_for_type(x509.UniformResourceIdentifier)
    return found[0] if found else ""
