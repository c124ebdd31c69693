"""Write the manifest of a captured set from what is in a folder, for a person to complete."""

import json
import re
import textwrap
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from dfdbench.building import folder_layout
from dfdbench.building.folder_facts import Facts, look_into, look_into_stacks
from dfdbench.building.sources.folder import what_is_in
from dfdbench.building.sources.image_files import SUFFIXES
from dfdbench.datasets.captured_files import ANY_ENDING, CapturedFiles
from dfdbench.datasets.manifest import FOUND, Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.errors import InputError, Problem, SourceError
from dfdbench.tables.table import counted, listed

_TEST = 4  # unless a set has splits, every fourth scene or place is for testing
_NAMED, _FEWEST = 6, 2
_SAFE = re.compile(r"[^A-Za-z0-9._-]+")
_COUNTED = re.compile(r"[-_.]?\d+$")
_ROW = 96
_SCALE = """\
# Metres become levels linearly in 1/z; law = "linear" would make them linear in z.
[depth.scale]
law = "inverse"
near = {}
far = {}

"""


@dataclass(frozen=True)
class NewManifest:
    """A manifest that was written from a folder.

    Parameters
    ----------
    name : str
        The name of its file, ``NAME-1.toml``.
    toml : str
        Its text.
    found, open : tuple of str
        In words: what was found, and what a person has to fill in.
    """

    name: str
    toml: str
    found: tuple[str, ...]
    open: tuple[str, ...]


def new_manifest(folder: Path, name: str | None = None) -> NewManifest:
    """Inspect a folder of captures and write the manifest of a set made from them.

    Parameters
    ----------
    folder : Path
        Either two photographs and a depth map per scene: in a folder per scene, in a folder per
        kind, or matched by the start or the end of their names. Or one photograph and a depth map,
        for a recipe to blur. Or a folder per scene with photographs that differ by a number, a
        depth map, and a table of their focus distances.
    name : str, optional
        The data set's name; the folder's by default.

    Raises
    ------
    InputError
        If it is not a folder, or holds no files that belong together.
    SourceError
        If an inspected file is damaged.
    """
    if not folder.is_dir():
        is_file = folder.exists()
        what = f"{folder.name} is a file, not a folder" if is_file else "no such folder"
        raise InputError(what, where=str(folder), fix="name the folder that holds the captures")
    layout, facts = _look(folder, folder_layout.image_files(folder))
    stem = _safe(name or folder.resolve().name) or "captures"
    scenes = _scenes(layout, facts)
    _tell_layout(layout, facts, scenes)
    text = "\n".join((_head(stem, facts, scenes), *_listed(scenes)))
    return NewManifest(f"{stem}-1.toml", text, tuple(facts.found), tuple(facts.open))


def _look(folder: Path, paths: tuple[str, ...]) -> tuple[folder_layout.Layout, Facts]:
    """Return how files belong together and what they are: pairs, or else stacks."""
    stacks, layout = folder_layout.find_stacks(folder, paths), folder_layout.find_layout(paths)
    by_stacks = stacks is not None and any(group.is_depth for group in stacks.groups)
    if layout is not None and not by_stacks:
        try:
            return layout, look_into(folder, layout)
        except InputError:
            if stacks is None:
                raise
        except SourceError as error:
            left = [Problem(text, where=str(folder)) for text in _left(layout)]
            raise SourceError.of([*error.problems, *left]) from error
    if stacks is not None:
        return stacks, look_into_stacks(folder, stacks)
    # A single scene may lie in the folder itself.
    if len(paths) >= _FEWEST and not any("/" in path for path in paths):
        alone = folder_layout.one_scene(folder, paths)
        if sum(group.is_depth for group in alone.groups) == 1:
            return alone, look_into(folder, alone)
    what = "no scene with a photograph or two and a depth map that share a name or a folder"
    there = "; ".join(filter(None, (listed(paths, _NAMED), folder_layout.unread_files(folder))))
    if not there:
        raise InputError("the folder is empty", where=str(folder), fix="name one of photographs")
    what += f", and no stack ({', '.join(SUFFIXES)})"
    raise InputError(what, where=str(folder), got=there, fix=folder_layout.BY_HAND)


def with_found_scenes(manifest: Manifest, folder: Path | None) -> Manifest:
    """Return a manifest with the scenes found in a folder, if it asks for finding them.

    Each file that fits `files.infocus`, which has ``{file}`` for what differs, is a scene. Every
    fourth place is for testing, as in `new_manifest`. The scenes become part of the text, which a
    store keeps.

    Parameters
    ----------
    manifest : Manifest
        Any manifest; one without `find_scenes` is returned as it is.
    folder : Path or None
        The folder that the set is built from.

    Raises
    ------
    SourceError
        If no file fits the pattern.
    """
    if not manifest.find_scenes or manifest.scenes or folder is None or not folder.is_dir():
        return manifest
    # Reading the manifest checked that these are there.
    assert manifest.files is not None
    assert manifest.files.infocus is not None
    inside = manifest.files.folder_in(folder)
    head, _, tail = manifest.files.infocus.partition("{file}")
    ending = r"\.[^./]+" if tail == ANY_ENDING else re.escape(tail)
    fitting = re.compile(f"{re.escape(head)}([^/]+?){ending}")
    paths = folder_layout.image_files(inside)
    stems = {match[1]: None for path in paths if (match := fitting.fullmatch(path))}
    if not stems:
        what = f"no file fits files.infocus, {manifest.files.infocus}"
        fix = "mend the pattern in the manifest, or name another folder"
        raise SourceError(what, where=str(inside), got=what_is_in(inside), fix=fix)
    keys, taken, source = [("", stem) for stem in stems], set[str](), manifest.sources[0].name
    scenes = [
        _Scene(_safe_name(key, keys, taken, by_order=False), "", {"file": key[1]}, source)
        for key in keys
    ]
    text = "\n".join(_listed(scenes))
    return parse_manifest((manifest.toml + FOUND + text).encode(), f"{manifest.stem}.toml")


@dataclass(frozen=True)
class _Scene:
    name: str
    split: str
    names: dict[str, str]
    source: str = "mine"
    place: str = ""


def _scenes(layout: folder_layout.Layout, facts: Facts) -> list[_Scene]:
    whole = [key for key in layout.scenes if all(key in g.files for g in facts.roles.values())]
    taken: set[str] = set()
    safe = {key: _safe_name(key, whole, taken, layout.by_order) for key in whole}
    renamed = any(safe[key] != key[1] for key in whole)
    scenes = []
    for key in whole:
        split, name = key
        names = {"split": split} if split else {}
        if layout.by_order:
            names |= {role: Path(group.files[key]).stem for role, group in facts.roles.items()}
        elif any("{place}" in group.pattern for group in facts.roles.values()):
            names["place"], _, names["file"] = name.rpartition("/")
        elif renamed:
            names["file"] = name
        scenes.append(_Scene(safe[key], split, names, place=_place_of(name)))
    return scenes


def _place_of(name: str) -> str:
    """Return the place of a scene whose name has a folder: what its frames have in common."""
    place, _, frame = name.rpartition("/")
    # The same word in several folders is the same thing, seen by another camera.
    return _safe(place if frame[-1:].isdigit() or frame[:1].isdigit() else frame) if place else ""


def _safe_name(
    key: folder_layout.Key, keys: list[folder_layout.Key], taken: set[str], by_order: bool
) -> str:
    split, name = key
    twice = by_order or sum(other == name for _, other in keys) > 1
    safe = _safe(f"{split}-{name}" if split and twice else name)[:90]
    safe = f"scene-{safe}" if by_order and not split else safe or "scene"
    number, found = 2, safe
    while found.casefold() in taken:
        found, number = f"{safe}-{number}", number + 1
    taken.add(found.casefold())
    return found


def _safe(name: str) -> str:
    # Drop accents but keep the letters.
    plain = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    return _SAFE.sub("-", plain).strip("-._")


def _tell_layout(layout: folder_layout.Layout, facts: Facts, scenes: list[_Scene]) -> None:
    if not scenes:
        there = ", ".join(f"{len(group.files)} of {role}" for role, group in facts.roles.items())
        patterns = ", ".join(group.pattern for group in facts.roles.values())
        fix = f"name a scene's files alike in every scene: {folder_layout.BY_HAND}"
        raise InputError("no scene has all files", where=patterns, got=there, fix=fix)
    facts.found.insert(0, counted(len(scenes), "scene"))
    for role, group in facts.roles.items():
        if lacking := ["/".join(filter(None, k)) for k in layout.scenes if k not in group.files]:
            named = f"{counted(len(lacking), 'scene')} without {role}: {listed(lacking, _NAMED)}"
            facts.open.append(f"left out {named}")
    if layout.by_order:
        facts.open.append(
            "whether files go together by their order: their names have nothing in common"
        )
    facts.open += _left(layout)
    if len(scenes) > 1 and not _are_told(scenes):
        facts.open.append(
            "which scenes are for testing: now every fourth; scenes of one place belong together"
        )
    facts.open.append("title, licence, whom to cite; lens and camera under [rig]")


def _left(layout: folder_layout.Layout) -> list[str]:
    named = listed(layout.left, _NAMED)
    return [f"{counted(len(layout.left), 'file')} without a scene: {named}"] * bool(named)


def _listed(scenes: list[_Scene]) -> Iterator[str]:
    places = _places(scenes)
    yield from _splits(scenes, places)
    yield from (_scene_toml(*both) for both in zip(scenes, places, strict=True))


def _scene_toml(scene: _Scene, place: str) -> str:
    names = ", ".join(f"{key} = {_text(value)}" for key, value in scene.names.items())
    told = f'group = "{place}"\n' * (place != scene.name)
    told += f"names = {{ {names} }}\n" * bool(names)
    return f'[[scenes]]\nname = "{scene.name}"\nsource = "{scene.source}"\n{told}'


def _splits(scenes: list[_Scene], places: list[str]) -> list[str]:
    chosen: dict[str, list[str]] = {}
    told, distinct = _are_told(scenes), list(dict.fromkeys(places))
    for scene, place in zip(scenes, places, strict=True):
        counted = "train" if (distinct.index(place) + 1) % _TEST else "test"
        split = (told and _split_name(scene.split)) or counted
        chosen.setdefault(split, []).append(scene.name)
    if len(scenes) == 1 and not told:
        chosen = {"test": chosen["train"]}
    elif "test" not in chosen and told:
        # What did not train is for the test.
        chosen["test"] = chosen.pop(next(name for name in chosen if name != "train"))
    elif "test" not in chosen and len(scenes) > 1:
        last = [scene.name for scene, at in zip(scenes, places, strict=True) if at == places[-1]]
        chosen["train"] = [name for name in chosen["train"] if name not in last]
        chosen["test"] = last
    return [
        f'[[splits]]\nname = "{split}"\npartition = "own"\npairs = {len(names)}\n'
        f"scenes = [\n{_rows(names)}]\n"
        for split, names in sorted(chosen.items(), key=lambda item: item[0] != "train")
    ]


def _places(scenes: list[_Scene]) -> list[str]:
    # Cameras and people number the pictures of a place: Kitchen_1, Kitchen_2.
    places = [scene.place or _COUNTED.sub("", scene.name) or scene.name for scene in scenes]
    alone = len(set(places)) < (2 if any(scene.place for scene in scenes) else _TEST)
    return [
        scene.name if alone or places.count(place) == 1 else place
        for scene, place in zip(scenes, places, strict=True)
    ]


def _are_told(scenes: list[_Scene]) -> bool:
    """Return whether folders say which scenes train, and which do not."""
    splits = {_split_name(scene.split) for scene in scenes if scene.split}
    return all(scene.split for scene in scenes) and "train" in splits and len(splits) > 1


def _split_name(folder: str) -> str:
    known = {"training": "train", "testing": "test", "val": "validation"}
    return known.get(folder.lower(), folder.lower())


def _rows(names: list[str]) -> str:
    text = " ".join(f'"{name}",' for name in names)
    return textwrap.indent(textwrap.fill(text, _ROW - 1, break_on_hyphens=False), "    ") + "\n"


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def _head(name: str, facts: Facts, scenes: list[_Scene]) -> str:
    """Return the manifest up to its splits, with a note where files cannot tell."""
    count = len(scenes)
    recipe = '\nrecipe = "published"' * (not {"images", "defocus"} & set(facts.roles))
    what = "A focal stack" if "images" in facts.roles else "Two photographs"
    what = "A photograph" if recipe else what
    template = resources.files("dfdbench.building").joinpath("new_manifest.toml").read_text("utf-8")
    return template.format(
        name=name,
        what=what + " and a depth map" * ("depth" in facts.roles),
        scenes=counted(count, "scene"),
        crop=min(map(min, facts.shapes.values())),
        count=count,
        recipe=recipe,
        pair_images=_pair_images(facts),
        unit=facts.unit,
        scale=_SCALE.format(*facts.scale) if facts.scale else "",
        files=_files(facts, scenes),
    )


def _pair_images(facts: Facts) -> str:
    if "images" not in facts.roles:
        return ""
    first = "in focus all over" if "infocus" in facts.roles else "focused farthest"
    return f"pair_images = [0, 1] # for methods of pairs; 0 is {first}, the others go on to near\n"


def _files(facts: Facts, scenes: list[_Scene]) -> str:
    stated = dict(facts.files)
    for role, group in facts.roles.items():
        name = next((name for name in (role, "file") if name in scenes[0].names), "scene")
        stated[role] = _text(group.pattern.replace("{scene}", f"{{{name}}}"))
    lines = [f"{name} = {stated[name]}" for name in CapturedFiles.model_fields if name in stated]
    return "\n".join(("[files]", *lines)) + "\n"
