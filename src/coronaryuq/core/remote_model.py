"""A model on an UM-Bridge server, as a backend of 3D or 0D runs. The protocol: https://um-bridge-benchmarks.readthedocs.io."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, Field

from coronaryuq.core.errors import InputError

if TYPE_CHECKING:
    import numpy as np


class RemoteSettings(BaseModel):
    """An UM-Bridge server and its model: θ in, quantities out, one vector each."""

    model_config = ConfigDict(extra="forbid")

    url: str = Field("http://127.0.0.1:4242", pattern="^https?://", description="Address of the server.")
    model: str | None = Field(
        None,
        description="Name of the model on the server; null: `zerod` for 0D, `flow3d` for 3D, `flow3d_coarse` "
        "for coarse.",
    )
    outputs: list[str] | None = Field(
        None, description="Names of the components of the output, in order; null: those that the server reports."
    )
    parallel: int = Field(16, ge=1, le=1024, description="Number of simultaneous requests.")


class RemoteModel:
    """A model on an UM-Bridge server.

    Parameters
    ----------
    settings
        Address and names.
    name
        Name of the model.
    field
        Block of the configuration that contains the settings, for error messages.

    Attributes
    ----------
    outputs
        Names of the components of its output.

    Raises
    ------
    InputError
        If no server answers, if it has no such model, or if names and sizes differ.
    """

    def __init__(self, settings: RemoteSettings, name: str, field: str):
        self.settings, self.name, self.field = settings, name, field
        self._model, info = self._connect()
        self._inputs = info.get("inputNames")
        self.size = self._one("inputs", self._model.get_input_sizes())
        size = self._one("outputs", self._model.get_output_sizes())
        outputs = settings.outputs or info.get("outputNames")
        if outputs is None:
            raise self._error("outputs", None, f"the server does not name its {size} outputs; name them here")
        if len(outputs) != size:
            raise self._error("outputs", outputs, f"{len(outputs)} names, but the model has {size} outputs")
        self.outputs: list[str] = list(outputs)

    def evaluate(self, theta: "np.ndarray", names: Sequence[str]) -> "list[list[float] | str]":
        """Evaluate the model at rows of θ.

        Parameters
        ----------
        theta : (n, d)
            Inputs.
        names : (d,)
            Their names, which are put in the order that the server reports.

        Returns
        -------
        list
            Per row the outputs, or the server's reason for their absence.

        Raises
        ------
        InputError
            If the server no longer answers, or if its inputs are not these.
        """
        with ThreadPoolExecutor(self.settings.parallel) as threads:
            return list(threads.map(self._ask, self._rows(theta, list(names))))

    def _rows(self, theta: "np.ndarray", names: list[str]) -> Iterator[list[float]]:
        wanted = self._inputs or names
        if sorted(wanted) != sorted(names) or len(names) != self.size:
            known = ", ".join(self._inputs or [f"{self.size} numbers"])
            raise self._error("model", self.name, f"its inputs are {known}; the campaign has {', '.join(names)}")
        place = [names.index(name) for name in wanted]
        return ([float(row[k]) for k in place] for row in theta)

    def _ask(self, row: list[float]) -> "list[float] | str":
        from requests import RequestException
        from requests.exceptions import JSONDecodeError

        try:
            (answer,) = self._model([row])
        except JSONDecodeError:  # response of umbridge's own server if a model raises
            return "the server answered without a result; see its log"
        except RequestException as error:
            raise self._error("url", self.settings.url, f"the server does not answer ({_reason(error)})") from None
        except Exception as error:  # exception of umbridge for an error of the model
            return " ".join(str(error).split())
        if len(answer) != len(self.outputs):
            return f"{len(answer)} outputs in place of {len(self.outputs)}"
        return [float(value) for value in answer]

    def _connect(self) -> tuple[Any, dict[str, Any]]:
        url = self.settings.url.rstrip("/")
        try:
            import requests
            import umbridge
        except ImportError:
            raise self._error("url", url, "needs the package umbridge: pip install 'coronaryuq[umbridge]'") from None
        try:
            models = umbridge.supported_models(url)
            if self.name not in models:
                raise self._error("model", self.name, f"not on the server; it has {', '.join(models) or 'no model'}")
            info = requests.post(f"{url}/ModelInfo", json={"name": self.name}, timeout=60).json()
            return umbridge.HTTPModel(url, self.name), info
        except (requests.RequestException, KeyError, RuntimeWarning) as error:
            remedy = f"no UM-Bridge server answers there ({_reason(error)}); start it, or name another address"
            raise self._error("url", url, remedy) from None

    def _one(self, what: str, sizes: list[int]) -> int:
        if len(sizes) != 1:
            raise self._error("model", self.name, f"has {len(sizes)} vectors of {what}; expected one")
        return sizes[0]

    def _error(self, name: str, value: Any, remedy: str) -> InputError:
        return InputError("configuration", f"{self.field}.{name}", value, remedy)


def _reason(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:120]
