"""The page, in Chromium without a display; skipped where there is none."""
import os
import shutil
import unittest

from browser import CHROMIUM, Browser
from viewing import CIRCLE, Case

ARRAY = """
struct Disc { float2 centre; float radius; };
Disc place(int i) { Disc d; d.centre = float2(0.25 + 0.25 * float(i), 0.5); d.radius = 0.1; return d; }
param Disc discs[3] = init(place);
[Color] param float3 ink = float3(1.0, 0.0, 0.0);
param bool on = true;
[Domain(0.0, 1.0)] shader float3 main(float2 x) {
    float3 c = float3(0.0);
    for (int i = 0; i < 3; i++) { [Disc] if (on && length(x - discs[i].centre) < discs[i].radius) c = ink; }
    return c;
}
"""


@unittest.skipUnless(CHROMIUM, "chromium is not installed")
class Page(Case):
    def open(self, *args, **kw):
        v = self.view(*args, **kw)
        b = Browser()
        self.addCleanup(b.close)
        b.open(v.url)
        self.settle(b)
        return v, b

    def settle(self, b):
        b.wait("document.body && +document.body.dataset.shown > 0 && document.body.dataset.busy === '0'")

    def pixel(self, b, u, w, canvas="image"):
        return b.run("(()=>{const c=document.getElementById('%s');return Array.from(c.getContext('2d').getImageData(Math.floor(%g*c.width),Math.floor(%g*c.height),1,1).data)})()" % (canvas, u, w))

    def put_value(self, b, name, value, event="input", attribute="data-name"):
        b.run("(()=>{const e=document.querySelector('[%s=\"%s\"]');e.value=%s;e.dispatchEvent(new Event('%s'))})()" % (attribute, name, repr(value), event))

    def at(self, b, u, w):
        return b.run("(()=>{const r=document.getElementById('frame').getBoundingClientRect();return [r.left+%g*r.width,r.top+%g*r.height]})()" % (u, w))

    def test_a_slider_moves_pixels(self):
        v, b = self.open("--size", 64)
        self.assertEqual(self.pixel(b, 0.9, 0.5)[:3], [137, 137, 137])
        self.put_value(b, "radius", 0.9)
        b.wait("document.body.dataset.busy === '0'")
        self.assertEqual(self.pixel(b, 0.9, 0.5), [255, 255, 255, 255])
        self.assertEqual(v.state["values"]["radius"], 0.9)
        self.put_value(b, "centre.x", -0.5, "change", "data-number")
        b.wait("document.body.dataset.busy === '0'")
        self.assertEqual(v.state["values"]["centre"], [-0.5, -0.05])
        b.run("document.getElementById('reset').click()")
        b.wait("document.querySelector('[data-number=\"radius\"]').value === '0.4'")
        # Somebody else moves it.
        v.post("/params", {"params": {"radius": 0.7}})
        b.wait("document.querySelector('[data-number=\"radius\"]').value === '0.7'")
        self.assertEqual(b.errors, [])

    def test_pickers_boxes_and_handles(self):
        v, b = self.open("--size", 64, source=ARRAY)
        self.assertEqual(self.pixel(b, 0.5, 0.5)[:3], [255, 0, 0])
        self.put_value(b, "ink", "#00ff00")
        b.wait("document.body.dataset.busy === '0'")
        self.assertEqual(self.pixel(b, 0.5, 0.5)[:3], [0, 255, 0])
        x, y = self.at(b, 0.5, 0.5)
        b.mouse("mousePressed", x, y)
        for i in range(1, 9):
            b.mouse("mouseMoved", *self.at(b, 0.5, 0.5 - 0.04 * i))
        b.mouse("mouseReleased", *self.at(b, 0.5, 0.18))
        self.settle(b)
        b.wait("document.body.dataset.busy === '0'")
        centre = v.state["values"]["discs"][1]["centre"]
        self.assertAlmostEqual(centre[0], 0.5, 2)
        self.assertAlmostEqual(centre[1], 0.82, 2)
        self.assertEqual(self.pixel(b, 0.5, 0.18)[:3], [0, 255, 0])
        self.assertEqual(b.run("document.querySelector('[data-element=\"discs\"]').value"), "1")  # the element that was dragged
        b.run("document.querySelector('[data-name=\"on\"]').click()")
        b.wait("document.body.dataset.busy === '0'")
        self.assertEqual(self.pixel(b, 0.5, 0.18)[:3], [0, 0, 0])
        self.assertEqual(b.errors, [])

    def test_derivatives_points_and_cells(self):
        v, b = self.open("--size", 64)
        b.run("(()=>{const e=document.getElementById('component');e.value='radius';e.dispatchEvent(new Event('change'))})()")
        b.wait("document.body.dataset.gradient")
        self.assertEqual(self.pixel(b, 0.55, 0.525, "overlay")[3], 0)
        self.assertTrue(b.run("document.getElementById('scale-high').textContent").startswith("+"))
        b.mouse("mousePressed", *self.at(b, 0.6, 0.5))
        b.mouse("mouseReleased", *self.at(b, 0.6, 0.5))
        b.wait("document.getElementById('point').textContent.includes('nearest jump')")
        self.assertIn("length(x - centre) < radius", b.run("document.getElementById('point').textContent"))
        b.run("document.getElementById('show-cells').click()")
        b.wait("!document.getElementById('cells').hidden && document.getElementById('cells').naturalWidth > 100")
        self.assertEqual(b.errors, [])

    def test_saving(self):
        v, b = self.open("--size", 32)
        self.put("a.salt", CIRCLE.replace("centre)", "center)"))
        b.wait("document.body.dataset.status === 'error'")
        self.assertIn("a.salt:8:", b.run("document.getElementById('message').textContent"))
        self.assertEqual(self.pixel(b, 0.05, 0.05)[:3], [137, 137, 137])
        self.put("a.salt", CIRCLE.replace("0.25", "1.0"))
        b.wait("document.body.dataset.status === 'ready' && document.body.dataset.generation === '2' && document.body.dataset.busy === '0'")
        self.assertEqual(self.pixel(b, 0.05, 0.05)[:3], [255, 255, 255])
        self.assertTrue(b.run("document.getElementById('message').hidden"))
        self.assertEqual(b.errors, [])

    def test_a_fit(self):
        v, b = self.open("--size", 32)
        b.run("document.getElementById('target-current').click()")
        b.wait("!document.getElementById('target').hidden")
        self.put_value(b, "radius", 0.6, "change", "data-number")
        b.wait("document.body.dataset.busy === '0'")
        b.run("document.getElementById('fit-iterations').value = 60; document.getElementById('fit-start').click()")
        b.wait("document.body.dataset.fit === 'done' && document.body.dataset.iterations === '60'")
        b.wait("document.querySelector('#curve path')")
        self.assertIn("60 of 60", b.run("document.getElementById('fit-said').textContent"))
        self.assertLess(abs(v.state["values"]["radius"] - 0.4), 0.1)
        self.assertEqual(b.errors, [])


if __name__ == "__main__":
    unittest.main()
