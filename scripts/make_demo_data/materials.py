"""Procedural materials of the demo scene: every colour and bump comes from shader nodes."""
import bpy


class Graph:
    """Thin helper: g.add(type, inputs) makes a node, values are constants or output sockets."""

    def __init__(self, tree):
        self.tree = tree
        tree.nodes.clear()

    def add(self, kind, inputs=None, **properties):
        node = self.tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            socket = node.inputs[key]
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node

    def coordinates(self, scale=(1, 1, 1), kind="Object"):
        source = self.add("ShaderNodeTexCoord").outputs[kind]
        return self.add("ShaderNodeMapping", {"Vector": source, "Scale": scale}).outputs["Vector"]

    def noise(self, vector, scale, detail=6.0, roughness=0.6, distortion=0.0):
        return self.add("ShaderNodeTexNoise", {
            "Vector": vector, "Scale": scale, "Detail": detail, "Roughness": roughness,
            "Distortion": distortion}).outputs["Fac"]

    def voronoi(self, vector, scale, feature="F1", output="Distance"):
        return self.add("ShaderNodeTexVoronoi", {"Vector": vector, "Scale": scale},
                        feature=feature).outputs[output]

    def ramp(self, factor, stops, interpolation="LINEAR"):
        node = self.add("ShaderNodeValToRGB", {"Fac": factor})
        ramp = node.color_ramp
        ramp.interpolation = interpolation
        ramp.elements[0].position, ramp.elements[1].position = stops[0][0], stops[-1][0]
        ramp.elements[0].color = (*stops[0][1], 1)
        ramp.elements[1].color = (*stops[-1][1], 1)
        for position, colour in stops[1:-1]:
            ramp.elements.new(position).color = (*colour, 1)
        return node.outputs["Color"]

    def mix(self, factor, a, b, blend="MIX"):
        colour = lambda c: (*c, 1) if isinstance(c, tuple) else c
        return self.add("ShaderNodeMixRGB", {"Fac": factor, "Color1": colour(a),
                                             "Color2": colour(b)},
                        blend_type=blend).outputs["Color"]

    def math(self, operation, a, b=0.0):
        return self.add("ShaderNodeMath", {0: a, 1: b}, operation=operation).outputs["Value"]

    def bump(self, height, strength, distance=0.02):
        return self.add("ShaderNodeBump", {"Height": height, "Strength": strength,
                                           "Distance": distance}).outputs["Normal"]

    def surface(self, **inputs):
        names = {"colour": "Base Color", "roughness": "Roughness", "metallic": "Metallic",
                 "normal": "Normal", "specular": "Specular", "clearcoat": "Clearcoat"}
        shader = self.add("ShaderNodeBsdfPrincipled", {names[k]: v for k, v in inputs.items()})
        self.add("ShaderNodeOutputMaterial", {"Surface": shader.outputs["BSDF"]})


def material(name, build):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    build(Graph(made.node_tree))
    return made


def stone(g, light=(0.62, 0.57, 0.48), dark=(0.26, 0.22, 0.18), scale=1.0):
    """Weathered limestone: stains, grains and pits."""
    p = g.coordinates()
    stains = g.ramp(g.noise(p, 2.2 * scale, 5, 0.65, 0.6), [(0.3, dark), (0.62, light)])
    grains = g.ramp(g.noise(p, 38 * scale, 2, 0.7), [(0.35, (0.68, 0.66, 0.63)), (0.65, (1, 1, 1))])
    pits = g.ramp(g.voronoi(p, 14 * scale), [(0.06, (0.4, 0.38, 0.35)), (0.24, (1, 1, 1))])
    colour = g.mix(0.8, g.mix(0.75, stains, grains, "MULTIPLY"), pits, "MULTIPLY")
    g.surface(colour=colour, roughness=0.85, normal=g.bump(g.noise(p, 18 * scale, 3, 0.7), 0.45))


def paving(g):
    """Cobbles in three tones with dark joints and a ring of terracotta tiles."""
    p = g.coordinates()
    cell = g.add("ShaderNodeTexVoronoi", {"Vector": p, "Scale": 3.4, "Randomness": 0.75})
    tone = g.ramp(g.add("ShaderNodeSeparateRGB", {"Image": cell.outputs["Color"]}).outputs["R"],
                  [(0.0, (0.20, 0.17, 0.15)), (0.35, (0.42, 0.36, 0.30)),
                   (0.6, (0.55, 0.42, 0.32)), (0.85, (0.34, 0.34, 0.37))], "CONSTANT")
    joints = g.ramp(g.voronoi(p, 3.4, "DISTANCE_TO_EDGE"),
                    [(0.02, (0.10, 0.09, 0.07)), (0.07, (1, 1, 1))])
    for node in g.tree.nodes:  # the joints must follow the same cells
        if node.type == "TEX_VORONOI":
            node.inputs["Randomness"].default_value = 0.75
    grains = g.ramp(g.noise(p, 30, 3, 0.75), [(0.3, (0.65, 0.65, 0.65)), (0.7, (1.12, 1.1, 1.05))])
    stains = g.ramp(g.noise(p, 0.9, 5, 0.6, 0.5), [(0.35, (0.6, 0.56, 0.5)), (0.65, (1, 1, 1))])
    colour = g.mix(1.0, g.mix(1.0, g.mix(1.0, tone, joints, "MULTIPLY"), grains, "MULTIPLY"),
                   stains, "MULTIPLY")
    radius = g.add("ShaderNodeVectorMath", {0: p}, operation="LENGTH").outputs["Value"]
    ring = g.math("LESS_THAN", g.math("ABSOLUTE", g.math("SUBTRACT", radius, 2.05)), 0.22)
    tiles = g.add("ShaderNodeTexBrick", {
        "Vector": p, "Scale": 5.0, "Color1": (0.50, 0.17, 0.08, 1), "Color2": (0.62, 0.30, 0.14, 1),
        "Mortar": (0.16, 0.13, 0.11, 1), "Mortar Size": 0.03}).outputs["Color"]
    colour = g.mix(ring, colour, g.mix(1.0, tiles, grains, "MULTIPLY"))
    g.surface(colour=colour, roughness=0.8, normal=g.bump(joints, 0.6, 0.03))


def land(g):
    """Dry grass, earth and moss at several scales; bare rock where steep."""
    p = g.coordinates()
    far = g.ramp(g.noise(p, 0.06, 5, 0.7), [(0.38, (0.11, 0.13, 0.04)), (0.5, (0.24, 0.22, 0.08)),
                                            (0.62, (0.36, 0.29, 0.16))])
    mid = g.ramp(g.noise(p, 1.3, 5, 0.75), [(0.35, (0.45, 0.5, 0.35)), (0.65, (1.25, 1.15, 1))])
    near = g.ramp(g.noise(p, 24, 2, 0.8), [(0.35, (0.6, 0.62, 0.55)), (0.65, (1.25, 1.2, 1.1))])
    grass = g.mix(1.0, g.mix(1.0, far, mid, "MULTIPLY"), near, "MULTIPLY")
    rock = g.ramp(g.noise(p, 0.25, 5, 0.75), [(0.35, (0.16, 0.14, 0.13)),
                                                    (0.65, (0.46, 0.41, 0.36))])
    normal = g.add("ShaderNodeNewGeometry").outputs["Normal"]
    up = g.add("ShaderNodeSeparateXYZ", {"Vector": normal}).outputs["Z"]
    flat = g.ramp(up, [(0.86, (0, 0, 0)), (0.94, (1, 1, 1))])
    g.surface(colour=g.mix(flat, rock, grass), roughness=0.95, specular=0.1)


def leaves(g, dark=(0.012, 0.035, 0.012), light=(0.10, 0.19, 0.045)):
    p = g.coordinates()
    tuft = g.ramp(g.noise(p, 7, 5, 0.8), [(0.38, dark), (0.64, light)])
    g.surface(colour=tuft, roughness=0.7, specular=0.2, normal=g.bump(g.noise(p, 11, 2), 1.0, 0.1))


def metal(g, colour=(0.93, 0.52, 0.27), roughness=0.2):
    """Polished, lightly hammered metal with a little tarnish."""
    p = g.coordinates()
    dents = g.voronoi(p, 7, "F1")
    tarnish = g.noise(p, 5, 4, 0.7, 0.5)
    tone = g.ramp(tarnish, [(0.4, tuple(0.55 * c for c in colour)), (0.6, colour)])
    rough = g.math("ADD", g.math("MULTIPLY", tarnish, 0.12), roughness - 0.05)
    g.surface(colour=tone, metallic=1.0, roughness=rough, normal=g.bump(dents, 0.35, 0.03))


def glaze(g):
    """Glazed pottery: a blue pattern over white under a clear coat."""
    p = g.coordinates()
    edge = g.voronoi(p, 9, "DISTANCE_TO_EDGE")
    bands = g.add("ShaderNodeTexWave", {"Vector": p, "Scale": 3.2, "Distortion": 3.0,
                                        "Detail": 3.0}, bands_direction="Z").outputs["Fac"]
    pattern = g.math("MAXIMUM", g.math("LESS_THAN", edge, 0.045), g.math("GREATER_THAN", bands, 0.8))
    white = g.ramp(g.noise(p, 25, 4), [(0.3, (0.62, 0.60, 0.52)), (0.7, (0.86, 0.84, 0.78))])
    blue = g.ramp(g.noise(p, 18, 5), [(0.35, (0.01, 0.03, 0.16)), (0.65, (0.05, 0.16, 0.45))])
    g.surface(colour=g.mix(pattern, white, blue), roughness=0.3, clearcoat=0.8)


def wood(g):
    p = g.coordinates((1, 1, 0.18))
    rings = g.add("ShaderNodeTexWave", {"Vector": p, "Scale": 9.0, "Distortion": 7.0, "Detail": 5.0,
                                        "Detail Scale": 2.0}).outputs["Fac"]
    grain = g.ramp(rings, [(0.1, (0.10, 0.045, 0.018)), (0.8, (0.45, 0.24, 0.10))])
    fine = g.ramp(g.noise(g.coordinates((30, 30, 3)), 3, 4), [(0.3, (0.5, 0.5, 0.5)),
                                                              (0.7, (1.1, 1.1, 1.1))])
    g.surface(colour=g.mix(1.0, grain, fine, "MULTIPLY"), roughness=0.55,
              normal=g.bump(rings, 0.25, 0.01))


def cloth_ball(g):
    """A ball in eight gores of colour with stitched speckles."""
    p = g.coordinates()
    checker = g.add("ShaderNodeTexVoronoi", {"Vector": p, "Scale": 5.0}, distance="CHEBYCHEV")
    hue = g.add("ShaderNodeSeparateRGB", {"Image": checker.outputs["Color"]}).outputs["R"]
    colour = g.ramp(hue, [(0.0, (0.55, 0.03, 0.03)), (0.25, (0.75, 0.45, 0.04)),
                          (0.5, (0.04, 0.25, 0.22)), (0.75, (0.70, 0.66, 0.55))], "CONSTANT")
    weave = g.ramp(g.noise(p, 60, 2, 0.7), [(0.35, (0.5, 0.5, 0.5)), (0.65, (1.1, 1.1, 1.1))])
    g.surface(colour=g.mix(1.0, colour, weave, "MULTIPLY"), roughness=0.75)


def sky(world, sun_elevation, sun_rotation):
    """Nishita sky with procedural clouds; the sun itself is a lamp, which samples without noise."""
    world.use_nodes = True
    g = Graph(world.node_tree)
    direction = g.add("ShaderNodeTexCoord").outputs["Generated"]
    blue = g.add("ShaderNodeTexSky", sky_type="NISHITA", sun_disc=False, dust_density=1.5,
                 sun_elevation=sun_elevation, sun_rotation=sun_rotation).outputs["Color"]
    split = g.add("ShaderNodeSeparateXYZ", {"Vector": direction})
    height = g.math("ADD", g.math("MAXIMUM", split.outputs["Z"], 0.0), 0.12)
    plane = g.add("ShaderNodeCombineXYZ", {
        "X": g.math("DIVIDE", split.outputs["X"], height),
        "Y": g.math("DIVIDE", split.outputs["Y"], height), "Z": 3.7}).outputs["Vector"]
    cover = g.ramp(g.noise(plane, 0.8, 5, 0.6), [(0.47, (0, 0, 0)), (0.68, (0.9, 0.9, 0.9))])
    shade = g.ramp(cover, [(0.2, (8.5, 8.4, 8.2)), (0.9, (5.4, 5.6, 6.0))])
    clouded = g.add("ShaderNodeBackground", {"Color": g.mix(cover, blue, shade), "Strength": 0.11})
    # What lights the scene is the sky without cloud detail: the same within a few per cent, and the
    # noise texture is not evaluated for every shadow ray.
    plain = g.add("ShaderNodeBackground", {"Color": g.mix(0.25, blue, (6.5, 6.6, 6.8)),
                                           "Strength": 0.11})
    path = g.add("ShaderNodeLightPath").outputs
    seen = g.math("MAXIMUM", path["Is Camera Ray"], path["Is Glossy Ray"])
    mixed = g.add("ShaderNodeMixShader", {0: seen, 1: plain.outputs["Background"],
                                          2: clouded.outputs["Background"]})
    g.add("ShaderNodeOutputWorld", {"Surface": mixed.outputs["Shader"]})
