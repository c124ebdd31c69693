"""A web server on the loopback that serves a folder, and fails as it is told to."""

import ssl
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any


class Site:
    """What is served, what has been asked for, and which faults are still to come.

    Faults are strings by path, used up one a request: a status such as ``"500"``; ``"truncate"``,
    half the body; ``"wrong"``, other bytes; ``"stall"``, half the body and then silence;
    ``"redirect"``, to the same file below ``/moved``; ``"none"``, as it should be.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.faults: dict[str, list[str]] = defaultdict(list)
        self.requests: list[str] = []
        self.released = threading.Event()
        self.address = ""

    def asked_for(self, path: str) -> int:
        """How many requests there were for a path."""
        return self.requests.count(path)


@contextmanager
def served(folder: Path, certificate: ssl.SSLContext | None = None) -> Iterator[Site]:
    site = Site(folder)
    server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(site))
    server.daemon_threads = True
    site.address = f"http://127.0.0.1:{server.server_port}"
    if certificate:
        server.socket = certificate.wrap_socket(server.socket, server_side=True)
        site.address = f"https://localhost:{server.server_port}"
    # Asked to stop, it looks once in an interval, of half a second if nobody says otherwise.
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield site
    finally:
        site.released.set()
        server.shutdown()
        server.server_close()


def _handler(site: Site) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, format: str, *args: Any) -> None:
            pass

        def do_GET(self) -> None:
            path = self.path.removeprefix("/moved")
            site.requests.append(path)
            fault = site.faults[path].pop(0) if site.faults[path] else "none"
            file = site.folder / path.lstrip("/")
            if fault.isdigit() or not file.is_file():
                self.send_error(int(fault) if fault.isdigit() else 404)
            elif fault == "redirect":
                self.send_response(302)
                self.send_header("Location", f"/moved{path}")
                self.send_header("Content-Length", "0")
                self.end_headers()
            else:
                self._send(file.read_bytes(), fault)

        def _send(self, body: bytes, fault: str) -> None:
            self.send_response(200)
            if fault == "wrong":
                body = bytes(byte ^ 0x55 for byte in body)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            if fault in ("truncate", "stall"):
                self.wfile.write(body[: len(body) // 2])
                self.wfile.flush()
                if fault == "stall":
                    site.released.wait(20)
                self.close_connection = True
                return
            self.wfile.write(body)

    return Handler
