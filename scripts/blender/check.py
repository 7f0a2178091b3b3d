"""What scripts/check_in_blender does inside Blender (3.4 or newer), as

  blender --background --factory-startup --python check.py -- layers EXR NPY_FOLDER OUT
  ...                                                         flight MESH CAMERAS FLIGHT_OUT OUT
  ...                                                         compare CAMERAS DRAWN RENDERED

Prints rows of a table, and fails where what it compares does not agree.
"""
import json
import os
import struct
import sys

import bpy
import numpy as np

# Debian 12's Blender 3.4 reads glTF by this name, which Debian's numpy 1.24 has no longer.
if "bool" not in np.__dict__:
    np.bool = bool

WIDTH, HEIGHT, FRAMES = 640, 480, 5


failures = []


def row(what, compared, result, bound, ok):
    print(f"| {what} | {compared} | {result} | {bound} |")
    if not ok:
        failures.append(what)


def pixels_of(path):
    """[height][width][4], the first row on top."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    values = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[::-1]


def new_tree(scene):
    scene.use_nodes = True
    scene.node_tree.nodes.clear()
    return scene.node_tree


def file_output(tree, folder):
    """A node that writes OpenEXR of 32 bits: a file NAME_0001.exr for each slot."""
    node = tree.nodes.new("CompositorNodeOutputFile")
    node.base_path = folder
    node.format.file_format = "OPEN_EXR"
    node.format.color_depth = "32"
    node.format.exr_codec = "ZIP"
    node.file_slots.clear()
    return node


def layers(exr, npy_folder, out):
    """Every socket of an Image node goes into a file, which is compared with the .npy of its layer."""
    view = os.path.splitext(os.path.basename(exr))[0]
    layer_names = {"Combined": "rgba", "depth": "depth.z"}
    scene = bpy.context.scene
    tree = new_tree(scene)
    image = bpy.data.images.load(exr)
    written = file_output(tree, out)
    found = {}
    for group in ("", "depth"):  # what Blender makes of "R" and "normal.X", and of "depth.p05.Z"
        node = tree.nodes.new("CompositorNodeImage")
        node.image = image
        if group:
            node.layer = group
        for socket in node.outputs:
            name = f"depth.{socket.name}" if group else layer_names.get(socket.name, socket.name)
            if not socket.enabled or socket.name == "Alpha" or name in found:
                continue
            if not os.path.isdir(os.path.join(npy_folder, name)):
                print("left out", name)
                continue
            written.file_slots.new(name)
            tree.links.new(socket, written.inputs[name])
            found[name] = socket
    viewer = tree.nodes.new("CompositorNodeComposite")
    tree.links.new(found["rgba"], viewer.inputs["Image"])
    expected = np.load(os.path.join(npy_folder, "rgba", view + ".npy"))
    scene.render.resolution_y, scene.render.resolution_x = expected.shape[:2]
    scene.render.resolution_percentage = 100
    bpy.ops.render.render()
    names, worst = sorted(os.listdir(npy_folder)), 0.0
    missing = [name for name in names if name not in found]
    for name in found:
        expected = np.load(os.path.join(npy_folder, name, view + ".npy"))
        channels = 1 if expected.ndim == 2 else expected.shape[2]
        got = pixels_of(os.path.join(out, f"{name}{scene.frame_current:04d}.exr"))[..., :channels]
        worst = max(worst, float(np.max(np.abs(got - expected.reshape(got.shape)))))
    row("layers through the compositor", f"{len(found)} of {len(names)} layers, every pixel",
        f"largest difference {worst:g}" + (f", missing: {missing}" if missing else ""), "0",
        not missing and worst == 0)


def imported(path):
    """The objects that a glTF file brings."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=path)
    return [o for o in bpy.data.objects if o not in before]


def flight(mesh, cameras, flight_file, out):
    """A camera flies from a training camera to another; the mesh is drawn as it sees it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    surface = [o for o in imported(mesh) if o.type == "MESH"]
    training = sorted((o for o in imported(cameras) if o.type == "CAMERA"), key=lambda o: o.name)
    bpy.context.view_layer.update()
    first, last = training[0], training[len(training) // 8]
    data = first.data.copy()
    data.clip_start, data.clip_end = 0.01, 1000
    camera = bpy.data.objects.new("flight", data)
    scene.collection.objects.link(camera)
    scene.render.fps = 24
    scene.frame_start, scene.frame_end = 1, FRAMES
    camera.rotation_mode = "QUATERNION"
    for frame, pose in ((1, first), (FRAMES, last)):
        place, turn, _ = pose.matrix_world.decompose()
        if frame > 1 and camera.rotation_quaternion.dot(turn) < 0:
            turn.negate()
        camera.location, camera.rotation_quaternion = place, turn
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_quaternion", frame=frame)

    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = 0.01  # rays through the pixels' middles
    scene.render.film_transparent = True
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.resolution_percentage = 100
    bpy.context.view_layer.use_pass_z = True
    tree = new_tree(scene)
    source = tree.nodes.new("CompositorNodeRLayers")
    written = file_output(tree, out)
    for name, socket in (("alpha", "Alpha"), ("depth", "Depth")):
        written.file_slots.new(name)
        tree.links.new(source.outputs[socket], written.inputs[name])
    composite = tree.nodes.new("CompositorNodeComposite")
    tree.links.new(source.outputs["Image"], composite.inputs["Image"])
    poses = []
    for frame in range(1, FRAMES + 1):
        scene.frame_set(frame)
        poses.append([list(line) for line in camera.matrix_world])
        bpy.ops.render.render()
    with open(os.path.join(out, "poses.json"), "w", encoding="utf-8") as file:
        json.dump({"poses": poses, "first": first.name}, file)

    bpy.ops.object.select_all(action="DESELECT")
    camera.select_set(True)
    bpy.ops.export_scene.gltf(filepath=flight_file, export_format="GLB", use_selection=True,
                              export_cameras=True, export_yup=True, export_animations=True)
    hidden = [o.name for o in training if not o.data.clip_start < o.data.clip_end]
    row("what imported cameras see", f"clip range of {len(training)} cameras",
        f"{len(hidden)} that see nothing", "0", not hidden)
    triangles = sum(len(o.data.polygons) for o in surface)
    colours = sum(len(o.data.color_attributes) for o in surface)
    row("mesh and cameras imported", f"{triangles} triangles, {len(training)} cameras",
        f"{colours} set of colours", "1", colours == 1 and triangles > 1000)


def json_of_glb(path):
    with open(path, "rb") as file:
        head = file.read(20)
        return json.loads(file.read(struct.unpack("<I", head[12:16])[0]))


def world_to_camera(exr):
    """The 4x4 of a file's header; points are rows, x right, y up, z forward."""
    with open(exr, "rb") as file:
        data = file.read(65536)
    at = data.index(b"worldToCamera\0m44f\0") + len(b"worldToCamera\0m44f\0") + 4
    return np.array(struct.unpack("<16f", data[at:at + 64])).reshape(4, 4)


def grown(mask, by):
    """A mask with all pixels at most so many rows and columns away."""
    for axis in (0, 1):
        wide = mask.copy()
        for step in range(1, by + 1):
            for shift in (step, -step):
                moved = np.roll(mask, shift, axis)
                edge = [slice(None)] * 2
                edge[axis] = slice(0, shift) if shift > 0 else slice(shift, None)
                moved[tuple(edge)] = False
                wide |= moved
        mask = wide
    return mask


def compare(cameras, drawn, rendered):
    extras = json_of_glb(cameras)["asset"]["extras"]
    input_to_gltf = np.array(extras["input_to_gltf"]).reshape(4, 4).T
    to_blender = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # z up
    with open(os.path.join(drawn, "poses.json"), encoding="utf-8") as file:
        poses = json.load(file)["poses"]
    files = sorted(os.listdir(os.path.join(rendered, "exr")))
    if len(files) != len(poses):
        sys.exit(f"{len(poses)} frames in Blender, {len(files)} in nerf_render's path")

    moved, turned, overlaps, bounds, depths = 0.0, 0.0, [], [], []
    for index, (name, pose) in enumerate(zip(files, poses)):
        wanted = np.linalg.inv(to_blender @ input_to_gltf) @ np.array(pose)  # y up, z backward
        got = np.linalg.inv(world_to_camera(os.path.join(rendered, "exr", name)).T)
        got[:, 2] *= -1
        moved = max(moved, float(np.linalg.norm(got[:3, 3] - wanted[:3, 3])))
        turned = max(turned, float(np.linalg.norm(got[:3, :3] - wanted[:3, :3], 2)))

        view = os.path.splitext(name)[0]
        load = lambda layer: np.load(os.path.join(rendered, "npy", layer, view + ".npy"))
        alpha, depth = (pixels_of(os.path.join(drawn, f"{kind}{index + 1:04d}.exr"))[..., 0]
                        for kind in ("alpha", "depth"))
        ours, theirs = load("opacity") > 0.5, alpha > 0.5
        overlaps.append((ours & theirs).sum() / (ours | theirs).sum())
        # Both sample pixels' middles (one pixel); fusion blurs the surface by a few voxels of half a pixel.
        edge = 3
        bounds.append((~grown(~ours, edge)).sum() / grown(ours, edge).sum())
        both = ~grown(~(ours & theirs), edge)
        depths.append(np.median(np.abs(depth[both] / load("depth.z")[both] - 1)))
    row("camera animated in Blender", f"{len(poses)} poses of --path",
        f"{moved:.1e} input units, {turned:.1e} rad", "1e-5", max(moved, turned) < 1e-5)
    worst = int(np.argmin(np.array(overlaps) - np.array(bounds)))
    row("silhouette of the mesh", f"{len(poses)} views of {WIDTH}x{HEIGHT}",
        f"intersection over union at least {min(overlaps):.3f}", f"{bounds[worst]:.3f}",
        all(o > b for o, b in zip(overlaps, bounds)))
    row("depth of the mesh", "the same, away from edges", f"median difference {100 * max(depths):.2f} %",
        "1 %", max(depths) < 0.01)
    print("| Blender", bpy.app.version_string, "| | | |")


COMMANDS = {"layers": layers, "flight": flight, "compare": compare}
command, *arguments = sys.argv[sys.argv.index("--") + 1:]
COMMANDS[command](*arguments)
if failures:
    sys.exit("does not agree: " + ", ".join(failures))
