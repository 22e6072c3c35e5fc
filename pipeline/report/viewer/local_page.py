"""The viewer's page for a browser, kept from talking to anybody but this machine."""

from __future__ import annotations

import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

# The viewer in a browser asks for news, fonts and examples, and reports its use: the policy lets none of it out.
_POLICY = (
    "default-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; worker-src 'self' blob:;"
    " script-src 'self' 'unsafe-inline' 'unsafe-eval' 'wasm-unsafe-eval' blob:;"
    " connect-src 'self' data: blob: http://127.0.0.1:{data_port} http://localhost:{data_port}"
)
_TIMEOUT_S = 60.0


class LocalPage:
    """Hands on what the viewer serves, with a policy that forbids all other addresses.

    Args:
        served: port where the viewer serves its page, on this machine.
        data_port: port where it gives out recordings.
    """

    def __init__(self, served: int, data_port: int) -> None:
        policy = _POLICY.format(data_port=data_port)

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                try:
                    with urllib.request.urlopen(f"http://127.0.0.1:{served}{self.path}", timeout=_TIMEOUT_S) as found:
                        body, kind = found.read(), found.headers.get("Content-Type", "application/octet-stream")
                except (urllib.error.URLError, OSError):
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.send_header("Content-Security-Policy", policy)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                """Says nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.port = int(self._server.server_address[1])
        Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Stops serving."""
        self._server.shutdown()
        self._server.server_close()
