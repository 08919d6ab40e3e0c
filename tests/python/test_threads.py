"""Threads, memory, processes: one program in two threads, calls that let Python run, nothing that grows."""
import gc
import resource
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor

from harness import *

SIDE = 16
ROUNDS = int(os.environ.get("SALTUS_ROUNDS", 1))  # more of the same, under a sanitizer


def resident():
    """Bytes of memory that are in use now."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def together(*functions):
    """Runs them in threads of their own; what they return, or the first exception."""
    start = threading.Barrier(len(functions))

    def run(function):
        start.wait()
        return function()
    with ThreadPoolExecutor(len(functions)) as pool:
        return [future.result() for future in [pool.submit(run, f) for f in functions]]


class Threads(Case):
    def work(self, p, seed, **more):
        adjoint = np.full((SIDE, SIDE, 3), 0.5)
        out = []
        for k in range(20 * ROUNDS):
            out.append(p.render(SIDE, seed=seed + k, **more).sum())
            out.append(p.vjp(adjoint, seed=seed + k, **more).vector.sum())
            out.append(p.eval([0.3, 0.4], **more).sum())
        return out

    def test_two_programs(self):
        p, q = saltus.compile(DISCS), saltus.compile(DISCS, set={"N": 5})
        alone = [self.work(p, 0), self.work(q, 100)]
        self.assertEqual(together(lambda: self.work(p, 0), lambda: self.work(q, 100)), alone)

    def test_one_program(self):
        """One at a time uses it: the results are as if alone, whatever the others give for their calls."""
        p = saltus.compile(DISCS)
        other = {"paper": [0.1, 0.2, 0.3], "discs": {"radius": 0.2}}
        alone = [self.work(p, 0), self.work(p, 0, params=other), self.work(p, 50)]
        self.assertEqual(together(lambda: self.work(p, 0), lambda: self.work(p, 0, params=other), lambda: self.work(p, 50)), alone)

    def test_one_program_and_other_derivatives(self):
        p = saltus.compile(DISCS)
        adjoint = np.ones((SIDE, SIDE, 3))

        def differentiated(names):
            return lambda: [tuple(p.vjp(adjoint, wrt=names)) for _ in range(30 * ROUNDS)]
        results = together(differentiated("paper"), differentiated(("discs[*].radius",)), differentiated(None))
        self.assertEqual([set(r) for r in results], [{("paper",)}, {("discs",)}, {("discs", "paper")}])

    def test_assignment_during_a_call(self):
        """Numbers that change under a call: it has the old or the new ones, and nothing else breaks."""
        source = "param int n = 1;\nparam float a = 0.0;\nshader float main(float2 x) { float f = a; for (int i = 0; i < 64; i++) { if (i < n) f += 0.5; } return f; }"
        p, stop = saltus.compile(source), threading.Event()

        def change():
            k = 0
            while not stop.is_set():
                k += 1
                p["n"] = 1 + k % 50
        thread = threading.Thread(target=change)
        thread.start()
        try:
            for _ in range(30 * ROUNDS):
                image = p.render(64, threads=2)
                self.assertEqual(len(np.unique(image)), 1)
        finally:
            stop.set()
            thread.join()

    def test_fits_that_share_a_view(self):
        p, q = saltus.compile(DISCS), saltus.compile(DISCS)
        target = np.ones((8, 8, 3))

        def fits(a, b):
            return lambda: [a.fit(views=[{"target": target}, {"target": target, "program": b}], iters=2).iterations for _ in range(5 * ROUNDS)]
        self.assertEqual(together(fits(p, q), fits(q, p)), [[2] * 5 * ROUNDS] * 2)

    def test_not_the_main_thread(self):
        """Everything works there, a fit with its callback and progress too."""
        def work():
            p = saltus.compile(DISCS)
            seen = []
            p.render(SIDE, progress=seen.append)
            p.fit(np.ones((8, 8, 3)), iters=2, callback=lambda at: seen.append(at.loss) and False)
            return len(seen) > 2, p.integral(64).value.shape
        self.assertEqual(together(work, work), [(True, (3,))] * 2)

    def test_others_run_meanwhile(self):
        """A long call lets go of the interpreter: another thread counts on, which between two calls it does once or twice."""
        p, count, stop = saltus.compile(DISCS), [0], threading.Event()

        def counting():
            while not stop.is_set():
                count[0] += 1
                time.sleep(0)
        thread = threading.Thread(target=counting)
        thread.start()
        try:
            for function in (lambda: p.render(512, spp=64, threads=1), lambda: p.integral(1 << 20, threads=1, estimator="lattice"),
                             lambda: p.eval(np.zeros((1 << 20, 2)), threads=1), lambda: p.bound(np.zeros((1 << 15, 2)), np.ones((1 << 15, 2))),
                             lambda: saltus.compile(DISCS, set={"N": 40}, cache=False).vjp(np.ones((8, 8, 3)))):
                before = count[0]
                function()
                self.assertGreater(count[0] - before, 5)
        finally:
            stop.set()
            thread.join()

    def test_prints_of_threads(self):
        p, lines = saltus.compile("shader float main(float2 x) { print(\"x = \", x.x); return x.x; }"), []
        p.set_print(lines.append)
        p.render(64, spp=1, threads=2)
        self.assertEqual(len(lines), 64 * 64)


class Memory(Case):
    SLACK = 6 << 20  # bytes

    def grows(self, step, n, warm=200):
        for _ in range(warm):
            step()
        gc.collect()
        before = resident()
        for _ in range(n):
            step()
        return resident() - before

    def test_iterations(self):
        """10 000 of an optimisation's, with the garbage collector off: nothing is left to it."""
        p = saltus.compile(CIRCLE)
        adjoint, seed = np.ones((SIDE, SIDE, 1), np.float32), iter(range(10 ** 6))

        def step():
            p["radius"] = 0.3
            s = next(seed)
            p.render(SIDE, spp=1, threads=1, seed=s)
            p.vjp(adjoint, spp=1, threads=1, seed=s)
        gc.disable()
        self.addCleanup(gc.enable)
        self.assertLess(self.grows(step, 10000), self.SLACK)

    def test_other_calls(self):
        p = saltus.compile(DISCS)
        target = np.ones((8, 8, 3), np.float32)

        def step():
            p.eval(np.zeros((4, 2)), params={"paper": 0.5}, progress=lambda f: None)
            p.integral(64, threads=1, wrt="paper")
            p.jvp({"paper": 1}, 8, threads=1)
            p.loss(target, threads=1, wrt="paper")
            p.fit(target, iters=1, threads=1, wrt="paper", callback=lambda at: False)
            p.params_json()
            saltus.encode_png(target)
            try:
                p.render(8, progress=lambda f: 1 / 0)
            except ZeroDivisionError:
                pass
        gc.disable()
        self.addCleanup(gc.enable)
        self.assertLess(self.grows(step, 300, 50), self.SLACK)

    def test_programs_are_freed(self):
        """When the last reference goes, without the garbage collector."""
        gc.disable()
        self.addCleanup(gc.enable)

        def raising(*_):
            raise KeyError
        for use in (lambda p: p.render(SIDE, progress=lambda f: p.channels), lambda p: p.vjp(np.ones((8, 8, 3))), lambda p: p.set_print(print), lambda p: p.stats.dropped,
                    lambda p: p.fit(np.ones((8, 8, 3)), iters=1, callback=lambda at: p.render(4) is None, loss=lambda i, t: (p.dim, i)), lambda p: p.params["discs"][1],
                    lambda p: self.assertRaises(KeyError, p.render, 64, progress=raising), lambda p: self.assertRaises(KeyError, p.fit, np.ones((8, 8, 3)), callback=raising),
                    lambda p: self.assertRaises(saltus.UsageError, p.fit)):
            p = saltus.compile(DISCS)
            use(p)
            gone = weakref.ref(p)
            del p
            self.assertIsNone(gone())

    def test_compiled_and_dropped(self):
        sources = [DISCS.replace("0.15", "0.1%d" % k) for k in range(4)]

        def step():
            for source in sources:
                p = saltus.compile(source)
                p.render(8, threads=1)
                p.vjp(np.ones((8, 8, 3)), threads=1)
            try:
                saltus.compile(DISCS + "}")
            except saltus.CompileError:
                pass
        self.assertLess(self.grows(step, 50, 10), self.SLACK)


class Processes(Case):
    def test_forked(self):
        """A process that was forked compiles programs of its own."""
        out = self.python("import os, sys, saltus\nsource = %r\np = saltus.compile(source)\np.render(8)\nchild = os.fork()\n"
                          "if child == 0:\n    q = saltus.compile(source)\n    print(q.render(8).shape, flush=True)\n    os._exit(0)\n"
                          "sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))" % CIRCLE)
        self.assertEqual(out, "(8, 8, 1)\n")

    def test_pool(self):
        self.put("worker.py", "import numpy as np, saltus\ndef area(r):\n    p = saltus.compile(%r)\n    return float(p.integral(256, params={'radius': r}).value[0])\n" % CIRCLE)
        out = self.python("import multiprocessing, worker, sys\nif __name__ == '__main__':\n    with multiprocessing.get_context('spawn').Pool(2) as pool:\n"
                          "        print(len(pool.map(worker.area, [0.1, 0.2, 0.3])))", env={"PYTHONPATH": os.environ.get("PYTHONPATH", "") + os.pathsep + self.dir})
        self.assertEqual(out, "3\n")


if __name__ == "__main__":
    main()
