#!/usr/bin/env python3
"""How long the viewer takes: view.py SALTUS [FILE] [--steps N]. FILE must have a float parameter `radius`.

A step of a slider to pixels: POST /image with a value, until the last byte of the 256 x 256 picture is here. A save: from the rename of the file to the first
picture and the derivative of the new program, both here. Memory: of the process, over the steps. Medians and 95th percentiles, by the clock."""
import argparse
import http.client
import json
import os
import re
import shutil
import signal
import statistics
import subprocess
import tempfile
import time

HERE = os.path.dirname(os.path.abspath(__file__))


def main():
    a = argparse.ArgumentParser()
    a.add_argument("saltus")
    a.add_argument("file", nargs="?", default=os.path.join(HERE, "../../examples/circle/circle.salt"))
    a.add_argument("--steps", type=int, default=10000)
    a.add_argument("--saves", type=int, default=20)
    a = a.parse_args()
    folder = tempfile.mkdtemp()
    path = os.path.join(folder, "a.salt")
    shutil.copy(a.file, path)
    source = open(path).read()
    p = subprocess.Popen([a.saltus, "view", path, "--size", "256", "--json", "--no-cache"], stdout=subprocess.PIPE)
    at = json.loads(p.stdout.readline())
    c = http.client.HTTPConnection("127.0.0.1", at["port"])

    def ask(method, path, body=None):
        c.request(method, path, body=body, headers={"X-Saltus-Token": at["token"]})
        r = c.getresponse()
        data = r.read()
        assert r.status == 200, data
        return r, data

    def memory():
        return int(re.search(r"VmRSS:\s*(\d+)", open("/proc/%d/status" % p.pid).read()).group(1)) / 1024

    def say(what, seconds):
        s = sorted(1e3 * x for x in seconds)
        print("%-34s median %6.2f ms, 95 %% %6.2f ms, worst %6.2f ms" % (what, statistics.median(s), s[int(0.95 * (len(s) - 1))], s[-1]))

    ask("GET", "/gradient?component=radius")
    step = lambda i: ask("POST", "/image?draft=1", json.dumps({"params": {"radius": 0.3 + 1e-5 * (i % 10000)}}))
    for i in range(200):
        step(i)
    before, times = memory(), []
    for i in range(a.steps):
        t = time.perf_counter()
        step(i)
        times.append(time.perf_counter() - t)
    say("a step to pixels, %d steps" % a.steps, times)
    print("memory, MiB                        %.1f, then %.1f" % (before, memory()))
    times = []
    for i in range(20):
        t = time.perf_counter()
        ask("GET", "/gradient?component=radius")
        times.append(time.perf_counter() - t)
    say("a derivative image, 4 samples", times)
    generation = json.loads(ask("GET", "/state")[1])["generation"]
    times = []
    for i in range(a.saves):
        with open(path + "~", "w") as f:
            f.write(source.replace("return ", "f += float(%d) * 1e-9; return " % (i + 1) if "float f" in source else "return "))
        t = time.perf_counter()
        os.rename(path + "~", path)
        while json.loads(ask("GET", "/state")[1])["generation"] == generation:
            time.sleep(0.001)
        generation += 1
        ask("GET", "/image?draft=1")
        ask("GET", "/gradient?component=radius")
        times.append(time.perf_counter() - t)
    say("a save to image and derivative", times)
    p.send_signal(signal.SIGINT)
    p.wait()
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
