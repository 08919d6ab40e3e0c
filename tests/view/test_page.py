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
KINDS = """
import m;
struct S { float list[2]; };
param float2x2 turn = float2x2(1.0, 0.0, 0.0, 1.0);
param bool2 both = bool2(true, false);
param float table[2][3] = { { 1.0, 2.0, 3.0 }, { 4.0, 5.0, 6.0 } };
param S s = { { 1.0, 2.0 } };
param uint seed = 4000000000;
param int whole = 3;
param float k = 1.0;
shader float main(float2 x) {
    return gain * (turn * x).x + at[1].x + (both.x ? table[0][0] : 0.0) + s.list[0] + float(seed) * 1e-12 + float(whole) * 1e-9 + 0.0 * k;
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

    def test_every_number_has_a_control(self):
        self.put("m.salt", "param float gain = 0.25;\nparam float2 at[2] = { float2(0.1), float2(0.6) };\n")
        v, b = self.open("--size", 32, source=KINDS)
        names = b.run("Array.from(document.querySelectorAll('[data-name]')).map(e => e.dataset.name)")
        for name in ("m.gain", "m.at[0].x", "turn[0].x", "turn[1].y", "both.x", "both.y", "table[0][0]", "s.list[0]", "seed"):
            self.assertIn(name, names)
        self.assertEqual(b.run("Array.from(document.querySelectorAll('input, select, button')).filter(e => !e.labels.length && !e.ariaLabel && !e.textContent.trim()).length"), 0)
        self.put_value(b, "m.gain", 0.5)
        self.put_value(b, "turn[1].y", 0.5, "change", "data-number")
        self.put_value(b, "table", 1, "change", "data-element")
        self.put_value(b, "table[1]", 2, "change", "data-element")
        self.put_value(b, "table[1][2]", 7, "change", "data-number")
        b.run("document.querySelector('[data-name=\"both.y\"]').click()")
        b.wait("document.body.dataset.busy === '0'")
        values = v.state["values"]
        self.assertEqual((values["m.gain"], values["turn"], values["table"][1], values["both"]), (0.5, [[1, 0], [0, 0.5]], [4, 5, 7], [True, True]))
        self.assertEqual(b.errors, [])

    def test_numbers_at_their_ends(self):
        self.put("m.salt", "param float gain = 0.25;\nparam float2 at[2] = { float2(0.1), float2(0.6) };\n")
        v, b = self.open("--size", 32, source=KINDS)
        number = lambda name: b.run("document.querySelector('[data-number=\"%s\"]').value" % name)
        b.run("(()=>{const e=document.querySelector('[data-name=\"seed\"]');e.value=e.max;e.dispatchEvent(new Event('input'))})()")
        for name, typed, stays in (("k", "1e30", "1e+30"), ("k", "1e39", "1e+30"), ("k", "", "1e+30"), ("seed", "-1", "0"), ("whole", "3e9", "2147483647"), ("whole", "1.5", "2")):
            self.put_value(b, name, typed, "change", "data-number")
            b.wait("document.body.dataset.busy === '0'")
            self.assertEqual(float(number(name)), float(stays), typed)
            self.assertEqual(v.state["values"][name], float(stays))
        self.put_value(b, "seed", 4294967295, "change", "data-number")
        b.wait("document.body.dataset.busy === '0'")
        self.assertEqual(v.state["values"]["seed"], 4294967295)
        self.assertTrue(b.run("Array.from(document.querySelectorAll('input[type=number]')).every(e => e.scrollWidth <= e.clientWidth)"))
        # What was refused is not what is shown.
        self.assertIn("single precision", b.run("(()=>{document.querySelector('[data-number=\"k\"]').value='1e39';document.querySelector('[data-number=\"k\"]').dispatchEvent(new Event('change'));return new Promise(r=>setInterval(()=>document.body.dataset.busy==='0'&&r(document.getElementById('where').textContent),5))})()"))

    def test_the_derivative_follows_the_chosen_element(self):
        v, b = self.open("--size", 32, source=ARRAY)
        b.run("(()=>{const e=document.getElementById('component');e.value='discs[0].radius';e.dispatchEvent(new Event('change'))})()")
        b.wait("document.body.dataset.gradient")
        self.put_value(b, "discs", 2, "change", "data-element")
        b.wait("document.body.dataset.busy === '0' && document.body.dataset.gradient")
        self.assertEqual(b.run("document.getElementById('component').value"), "discs[2].radius")
        self.assertEqual(self.pixel(b, 0.25, 0.5, "overlay")[3], 0)
        self.assertEqual(b.errors, [])

    def test_points_by_keys(self):
        v, b = self.open("--size", 64)
        b.run("document.getElementById('image').focus()")
        for key, moved in (("Enter", [0, 0]), ("ArrowRight", [2 / 64, 0]), ("ArrowUp", [2 / 64, 2 / 64])):
            b.run("document.getElementById('point').replaceChildren()")
            b.call("Input.dispatchKeyEvent", type="keyDown", key=key)
            b.wait("document.querySelector('#point table')")
            told = [float(x) for x in b.run("document.querySelector('#point td.number').textContent").split(",")]
            self.assertTrue(all(abs(x - y) < 1e-4 for x, y in zip(told, moved)), told)

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
