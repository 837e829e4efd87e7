"""UM-Bridge's own server with models that know nothing of coronaryuq; run as a program: PORT."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

OUTPUTS = ["ffr_lad", "tawss_min_lad", "osi_max_lad"]


def answer(theta: list[float]) -> list[float]:
    """Outputs of both models at two inputs."""
    a, s = theta
    return [1.0 / (1.0 + 0.3 * a * s), 10.0 * a, 0.1 * s]


@contextmanager
def foreign_server() -> Iterator[str]:
    """Run the server; gives its address."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with subprocess.Popen([sys.executable, __file__, str(port)], stdout=subprocess.DEVNULL) as server:
        try:
            for _ in range(600):
                with socket.socket() as trial:
                    if trial.connect_ex(("127.0.0.1", port)) == 0:
                        break
                assert server.poll() is None, "the server ended"
                time.sleep(0.1)
            yield f"http://127.0.0.1:{port}"
        finally:
            server.terminate()


def main() -> None:
    import umbridge

    class Foreign(umbridge.Model):
        """Fails for a first input above 3."""

        def get_input_sizes(self, config):
            return [2]

        def get_output_sizes(self, config):
            return [3]

        def __call__(self, parameters, config):
            if parameters[0][0] > 3:
                raise RuntimeError("too large")
            return [answer(parameters[0])]

        def supports_evaluate(self):
            return True

    class TwoVectors(Foreign):
        def get_input_sizes(self, config):
            return [1, 1]

    umbridge.serve_models([Foreign("flow3d"), Foreign("mine"), TwoVectors("two")], int(sys.argv[1]))


if __name__ == "__main__":
    main()
