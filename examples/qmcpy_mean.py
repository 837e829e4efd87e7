"""Mean FFR over a box of inputs by quasi-Monte Carlo, with QMCPy as the client of `coronaryuq serve`.

    coronaryuq serve results/smoke                                    in one terminal
    python examples/qmcpy_mean.py http://127.0.0.1:4242 --samples 64  in another

QMCPy asks for eight samples at a time; the server runs those that arrive together as one batch.
"""

import argparse

import qmcpy
import requests
import umbridge


def main() -> None:
    parser = argparse.ArgumentParser(description="Mean FFR over a box of inputs by quasi-Monte Carlo.")
    parser.add_argument("url", help="address of the server")
    parser.add_argument("--samples", type=int, default=64, help="a power of two (default 64)")
    options = parser.parse_args()

    info = requests.post(f"{options.url}/ModelInfo", json={"name": "zerod"}, timeout=60).json()
    model = umbridge.HTTPModel(options.url, "zerod")
    points = qmcpy.DigitalNetB2(len(info["inputNames"]), seed=7)
    box = qmcpy.Uniform(points, lower_bound=0.8, upper_bound=1.25)
    outputs = qmcpy.UMBridgeWrapper(box, model, parallel=8)(options.samples)
    for name, values in zip(info["outputNames"], outputs, strict=True):
        if name.startswith("ffr_"):
            print(f"{name}: mean {values.mean():.4f}, standard deviation {values.std():.4f}")


if __name__ == "__main__":
    main()
