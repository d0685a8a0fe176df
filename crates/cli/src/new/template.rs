//! The text of a new scene.

use std::path::Path;

use bokashi_scene::gaze;
use glam::DVec3;

use super::mesh::{Paint, Start};
use super::photographs::{Photographs, Source};
use crate::digits::{count, number};

/// The horizontal angle of view of cameras that nobody knows, in degrees.
const ANGLE: f64 = 40.0;
/// How far such cameras stand from the middle of what they see, in its radii.
const DISTANCE: f64 = 3.5;
/// The share of what all cameras see that a sphere takes to start from.
const SPHERE: f64 = 0.5;
/// The views of a step.
const VIEWS: usize = 4;
/// Images are made smaller at first, where they are longer.
const LONGEST: usize = 600;
/// Of a mesh that is remeshed, edges are so long as seen, in shares of the longest side of an image: some 4 pixels
/// where the object fills half of it. They are no shorter than this share of the mesh's radius, for the sake of time.
const EDGES: f64 = 8.0;
const SHORTEST: f64 = 0.012;

/// What is there to begin with.
#[derive(Debug, Clone)]
pub(super) struct Template<'a> {
    pub(super) start: Option<&'a Start>,
    pub(super) photographs: Option<&'a Photographs>,
    /// Whether cameras are known roughly only.
    pub(super) has_rough_cameras: bool,
    /// Why masks make no hull, once that is known.
    pub(super) no_hull: Option<String>,
}

impl Template<'_> {
    /// Where the views come from, for the last words.
    pub(super) fn views(&self) -> String {
        let Some(photographs) = self.photographs else {
            return "one to look at, without an image".to_owned();
        };
        let images = count(photographs.images.len(), "image");
        match &photographs.source {
            Source::Transforms(file) => format!("{images}, cameras of {}", file.display()),
            Source::Colmap(model, _) => format!("{images}, cameras of {}", model.display()),
            Source::Nowhere => format!("{images} without cameras"),
        }
    }

    /// Where the masks come from, for the last words.
    pub(super) fn masks(&self) -> &'static str {
        match self.photographs {
            Some(photographs) if photographs.masks.is_some() || photographs.has_named_masks => {
                "a file for each image"
            }
            Some(photographs) if photographs.has_opacity => "the opacity of the images",
            Some(_) if self.learns_shape() => "none: without them a shape is hard to learn",
            _ => "none",
        }
    }

    /// What is learnt, for the last words.
    pub(super) fn learnt(&self) -> String {
        if self.photographs.is_none() {
            return "nothing: there are no images".to_owned();
        }
        let of_mesh = match self.start.map(|start| start.paint) {
            None if self.starts_from_hull() => {
                "the shape, from what the masks allow, and its colours"
            }
            None => "the vertices and the texture of the sphere",
            Some(Paint::Textures) => "the mesh's texture",
            Some(Paint::Coordinates) => "a texture of the mesh",
            Some(Paint::Colors) => "colours at the mesh's vertices",
            Some(Paint::Bare) => "the vertices and the colour of the mesh",
        };
        let cameras = if self.has_rough_cameras { "; cameras, too" } else { "" };
        format!("{of_mesh}{cameras}")
    }

    /// Whether somebody has to fill in cameras.
    pub(super) fn needs_cameras(&self) -> bool {
        self.photographs.is_some_and(|photographs| matches!(photographs.source, Source::Nowhere))
    }

    /// Whether the fit starts from what the masks allow.
    pub(super) fn starts_from_hull(&self) -> bool {
        self.no_hull.is_none()
            && self.start.is_none()
            && self.compares_masks()
            && !self.needs_cameras()
    }

    fn learns_shape(&self) -> bool {
        self.start.is_none_or(|start| start.paint == Paint::Bare)
    }

    /// Whether silhouettes are a part of the loss.
    fn compares_masks(&self) -> bool {
        self.learns_shape() && self.photographs.is_some_and(Photographs::has_masks)
    }

    /// The middle and the radius of the mesh.
    fn ball(&self) -> (DVec3, f64) {
        match (self.start, self.photographs) {
            (Some(start), _) if start.ball.1 > 0.0 => start.ball,
            (None, Some(photographs)) => match gaze(&photographs.cameras) {
                Some((center, radius)) => (rounded(center, radius), SPHERE * radius),
                None => (DVec3::ZERO, 1.0),
            },
            _ => (DVec3::ZERO, 1.0),
        }
    }

    /// All of `scene.toml`.
    pub(super) fn text(&self) -> String {
        let parts = [
            "# A scene for bokashi: what is in it, and what is learnt of it.\n\
             # The page docs/scene.md explains every key. Paths start at the folder of this file.\n\n\
             # Which views the steps see follows from it.\nseed = 0\n"
                .to_owned(),
            self.mesh(),
            self.camera_entries(),
            self.pipeline(),
            self.learn(),
            self.loss(),
            self.steps(),
        ];
        parts.join("\n")
    }

    fn mesh(&self) -> String {
        let Some(start) = self.start else {
            if self.starts_from_hull() {
                return "# The mesh to start from: what the masks of all views allow. With a file:\n\
                        # file = \"mesh.obj\" in place of shape and faces, and no `remesh` below.\n\
                        [[meshes]]\nname = \"object\"\nshape = \"hull\"\nfaces = 3000\n\
                        # The least share of views that agree where the object is. Others may have a bad mask.\n\
                        # agreement = 0.8\n\
                        # Colours are learnt at vertices, which move and change.\n\
                        material = { vertex_colors = true }\n"
                    .to_owned();
            }
            let (center, radius) = self.ball();
            let is_placed = (center, radius) != (DVec3::ZERO, 1.0);
            let place = match is_placed {
                true => format!(
                    "# Where the cameras look, half as large as what all of them see.\n\
                     place = {{ scale = {}, translation = {} }}\n",
                    number(radius),
                    vector(center)
                ),
                false => "# place = { scale = 1.0, translation = [0, 0, 0] }\n".to_owned(),
            };
            return format!(
                "# The mesh to start from. With a file: file = \"mesh.obj\" in place of shape and faces.\n\
                 [[meshes]]\nname = \"object\"\nshape = \"sphere\"  # or \"cube\", \"plane\"\n\
                 faces = 5000\n{place}# A texture of one colour to start from, in texels along a side.\n\
                 material = {{ texture_size = 256 }}\n"
            );
        };
        let material = match start.paint {
            Paint::Coordinates => {
                "# A texture of one colour to start from, in texels along a side.\n\
                 material = { texture_size = 512 }\n"
            }
            _ => "",
        };
        format!(
            "[[meshes]]\nfile = {}\n{material}\
             # A motion and a scale, where the cameras see the mesh elsewhere:\n\
             # place = {{ scale = 1.0, rotation = [0, 0, 0, 1], translation = [0, 0, 0] }}\n",
            text(&start.file)
        )
    }

    /// Cameras, and the views that have them.
    fn camera_entries(&self) -> String {
        let (center, radius) = self.ball();
        let Some(photographs) = self.photographs else {
            let position = center + DISTANCE * radius * DVec3::new(0.4, 0.3, 0.87).normalize();
            return format!(
                "# A view without an image can be rendered. With one: image = \"images/front.png\".\n\
                 [[views]]\nname = \"front\"\n[views.camera]\nsize = [512, 512]\n\
                 angle = {}  # of view, across, in degrees; or focal = 700.0, in pixels\n\
                 position = {}\ntarget = {}\n",
                number(ANGLE),
                vector(position),
                vector(center)
            );
        };
        let mut toml = match &photographs.source {
            Source::Transforms(file) => format!("[cameras]\ntransforms = {}\n", text(file)),
            Source::Colmap(model, images) => {
                format!("[cameras]\ncolmap = {}\nimages = {}\n", text(model), text(images))
            }
            Source::Nowhere => return self.views_to_fill_in(photographs, center, radius),
        };
        if photographs.masks.is_some() {
            toml += &format!("masks = {}\n", text(&photographs.mask_folder));
        }
        toml += "# Each so many-th view is measured and never learnt from.\n";
        toml += match photographs.has_held_out() {
            true => "held_out_every = 8\n",
            false => "# held_out_every = 8\n",
        };
        toml
    }

    fn views_to_fill_in(&self, photographs: &Photographs, center: DVec3, radius: f64) -> String {
        let mut toml = "# FILL IN the camera of each view: where it stood, what it looked at, and its angle\n\
             # of view across, in degrees. In place of these, a camera can have `pose`, four rows\n\
             # of a matrix, and `focal`, in pixels. Views that are held out are measured and never\n\
             # learnt from.\n"
            .to_owned();
        let position = center + DVec3::new(0.0, 0.0, DISTANCE * radius);
        for (k, image) in photographs.images.iter().enumerate() {
            toml += &format!("[[views]]\nimage = {}\n", text(image));
            if let Some(mask) = photographs.masks.as_ref().and_then(|masks| masks.get(k)) {
                toml += &format!("mask = {}\n", text(mask));
            }
            toml += &format!(
                "held_out = false\ncamera = {{ position = {}, target = {}, angle = {} }}\n\n",
                vector(position),
                vector(center),
                number(ANGLE)
            );
        }
        toml.truncate(toml.trim_end().len());
        toml.push('\n');
        toml
    }

    fn pipeline(&self) -> String {
        let mut toml = "[pipeline]\n\
             # \"exact\": the true gradient of edges. \"antialias\" is faster, for meshes whose faces are\n\
             # larger than pixels. \"aliased\" moves no edge.\nsilhouettes = \"exact\"\n\
             # The linear colour behind the objects.\nbackground = [0, 0, 0]\n\
             # \"srgb\" for photographs, \"linear\" for images of light.\ntone = \"srgb\"\n"
            .to_owned();
        if self.starts_from_hull() {
            toml += "# A hull is closed: what turns away from the camera is hidden, and need not be drawn.\n\
                     cull = \"back\"\n";
        }
        toml += "\n# With a light or an environment, surfaces answer light. Without, they show their colour.\n\
             # [[lights]]\n# kind = \"directional\"\n# direction = [1, 2, 3]  # towards the light\n\
             # color = [3, 3, 3]\n";
        toml
    }

    fn learn(&self) -> String {
        let vertices = "# Places of vertices. Smoothing makes steps large and smooth: more of it, smoother.\n\
             [learn.vertices]\nsmoothing = 10.0\n\n";
        let texture = "[learn.texture]\n\
             # Neighbouring texels are alike, where no view says otherwise.\ntotal_variation = 1e-3\n";
        let toml = match self.start.map(|start| start.paint) {
            None if self.starts_from_hull() => {
                let at_vertices =
                    "# Colours at vertices, and then a texture: from the last stage on.\n";
                format!("{vertices}{at_vertices}[learn.colors]\n\n{texture}")
            }
            None => format!("{vertices}{texture}"),
            Some(Paint::Textures | Paint::Coordinates) => texture.to_owned(),
            Some(Paint::Colors) => "[learn.colors]\nrate = 0.05\n".to_owned(),
            Some(Paint::Bare) => format!(
                "{vertices}# One colour: the mesh has no texture coordinates.\n[learn.texture]\n"
            ),
        };
        let pose = "# Where the mesh stands, if it does not lie on the images yet. From far off, so many rotations are\n\
             # tried first, on small images. Masks help: see `silhouette` below.\n\
             # [learn.pose]\n# starts = 64\n";
        let cameras = match self.has_rough_cameras {
            true => "# Where cameras stand: they are known roughly only.\n[learn.cameras]\n",
            false => {
                "# Where cameras stand, if they are known roughly only. Name them in `learn` of stages, too.\n\
                 # [learn.cameras]\n"
            }
        };
        let toml = format!("{toml}\n{pose}\n{cameras}");
        match self.photographs {
            Some(_) => toml,
            None => {
                format!("# To be learnt from images, once there are some:\n{}", commented(&toml))
            }
        }
    }

    fn loss(&self) -> String {
        let mut toml = match self.photographs.is_some() {
            true => {
                "[loss]\n# A view that does not fit, by its light or its mask, counts less than with \"squared\".\n\
                 kind = \"huber\"\n"
            }
            false => "[loss]\nkind = \"squared\"  # or \"absolute\", \"huber\"\n",
        }
        .to_owned();
        if self.compares_masks() {
            toml += "# The weight of silhouettes beside colours.\nsilhouette = 1.0\n";
        } else {
            toml += "# The weight of silhouettes beside colours: it needs masks, or images with opacity.\n\
                 # silhouette = 1.0\n";
        }
        toml
    }

    /// The rule by which held-out views end stages. Where cameras are learnt, each measure would have to align these first.
    fn stop(&self, photographs: &Photographs) -> &str {
        if !photographs.has_held_out() || self.has_rough_cameras {
            return "";
        }
        "# After `every` so many steps held-out views are measured. A stage ends before its last step once `patience`\n\
         # measures in turn were not better by `gain` decibels. Leave this out where no view is held out.\n\
         [stop]\nheld_out = { every = 50, patience = 3, gain = 0.05 }\n\n"
    }

    /// The stages of a fit from a hull: the shape roughly, then finely, and then a texture.
    fn stages_from_hull(&self, photographs: &Photographs) -> String {
        let (fine, views) = (reduce(&photographs.sizes), photographs.images.len().min(VIEWS));
        let longest = photographs.sizes.iter().flatten().copied().max().unwrap_or(1);
        let coarse = 2 * fine;
        let smaller = match fine {
            1 => "",
            _ => " Images are made smaller to some 600 pixels, for the sake of time.",
        };
        let length = |reduce: usize| {
            let length = EDGES * reduce as f64 / longest as f64;
            (1e3 * length.clamp(SHORTEST, 0.1)).round() / 1e3
        };
        let (first, last) = match self.has_rough_cameras {
            true => ("learn = [\"vertices\", \"colors\"]\n", "[\"texture\", \"cameras\"]"),
            false => ("", "[\"texture\"]"),
        };
        let alone = if self.has_rough_cameras { "and cameras" } else { "alone" };
        format!(
            "{}# First the shape, with small images and long edges. `remesh` gives the mesh even faces again, now and\n\
             # then: `length` is that of edges, as a share of the object's radius. Shorter, with more steps, shows more.\n\
             [[stages]]\nsteps = 200\nreduce = {coarse}\nviews_per_step = {views}\n\
             {first}remesh = {{ length = {}, every = 50 }}\n\n\
             # Then all of it.{smaller}\n\
             [[stages]]\nsteps = 600\nreduce = {fine}\nviews_per_step = {views}\nrates = 0.5\n\
             remesh = {{ length = {}, every = 100 }}\n\n\
             # At last colours {alone}, in a texture that begins as those at vertices. More texels than pixels that see\n\
             # the object show no more.\n\
             [[stages]]\nsteps = 300\nreduce = {fine}\nviews_per_step = {views}\n\
             texture = {{ size = {} }}\nlearn = {last}\n",
            self.stop(photographs),
            number(length(coarse)),
            number(length(fine)),
            (longest / fine).next_power_of_two().clamp(128, 2048)
        )
    }

    fn steps(&self) -> String {
        if let Some(photographs) = self.photographs.filter(|_| self.starts_from_hull()) {
            return self.stages_from_hull(photographs);
        }
        let steps = if self.learns_shape() { 1000 } else { 500 };
        let images = self.photographs.map_or(1, |photographs| photographs.images.len());
        let views = images.min(VIEWS);
        let reduce = self.photographs.map_or(1, |photographs| reduce(&photographs.sizes));
        if reduce == 1 {
            return format!("[[stages]]\nsteps = {steps}\nviews_per_step = {views}\n");
        }
        format!(
            "# With smaller images, which take less time, and then as they are.\n\
             [[stages]]\nsteps = {steps}\nreduce = {reduce}\nviews_per_step = {views}\n\n\
             [[stages]]\nsteps = {}\nviews_per_step = {views}\nrates = 0.3\n",
            steps / 5
        )
    }
}

/// How many times smaller images of these sizes become at first: a power of two.
fn reduce(sizes: &[[usize; 2]]) -> usize {
    let longest = sizes.iter().flatten().copied().max().unwrap_or(1);
    let mut reduce = 1;
    while longest / reduce > LONGEST {
        reduce *= 2;
    }
    reduce
}

/// A path as a string of TOML, with slashes.
fn text(path: &Path) -> String {
    let parts = path.components().map(|part| part.as_os_str().to_string_lossy().into_owned());
    let path = parts.collect::<Vec<_>>().join("/");
    let path = if path.is_empty() { ".".to_owned() } else { path };
    // Strings of JSON are strings of TOML, but for one letter that TOML wants escaped.
    serde_json::Value::from(path).to_string().replace('\u{7f}', "\\u007f")
}

fn vector(v: DVec3) -> String {
    format!("[{}]", v.to_array().map(number).join(", "))
}

/// A place, to a millionth of what is seen around it.
fn rounded(point: DVec3, radius: f64) -> DVec3 {
    let unit = 1e-6 * radius;
    let rounded = (point / unit).round() * unit;
    if rounded.is_finite() { rounded } else { point }
}

/// The lines as comments.
fn commented(text: &str) -> String {
    let line = |line: &str| if line.is_empty() { "#\n".to_owned() } else { format!("# {line}\n") };
    text.lines().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_made_smaller_down_to_some_600_pixels() {
        assert_eq!(reduce(&[[128, 128]]), 1);
        assert_eq!(reduce(&[[800, 800]]), 2);
        assert_eq!(reduce(&[[4032, 3024]]), 8);
        assert_eq!(reduce(&[[4032, 3025]]), 8);
        assert_eq!(reduce(&[]), 1);
    }

    #[test]
    fn paths_are_strings_of_toml() {
        assert_eq!(text(Path::new("a b/ü\".png")), "\"a b/ü\\\".png\"");
        assert_eq!(text(Path::new("")), "\".\"");
        assert_eq!(text(Path::new("a\u{7f}\n")), "\"a\\u007f\\n\"");
    }
}
