//! Images.

use std::path::Path;

use bokashi_scene::{Location, Mask, MaskKind, Picture, Samples, SceneError};
use serde_json::{Value, json};

use super::findings::{Findings, Section};
use super::folder::folder_of;
use crate::digits::{number, percent};

/// What is in the image `file`.
pub(super) fn inspect(file: &Path) -> Result<Findings, SceneError> {
    let (folder, name) = folder_of(file)?;
    let (bytes, location) = (folder.read(name)?, Location::new(file));
    let picture = Picture::decode(&bytes, &location)?;
    let mut findings = Findings::new("an image");
    let mut section = Section::default();
    let [width, height] = [picture.width, picture.height];
    section.fact("size", format!("{width} x {height} pixels"), json!([width, height]));
    let names: &[&'static str] = match picture.channels {
        1 => &["gray"],
        2 => &["gray", "opacity"],
        3 => &["red", "green", "blue"],
        _ => &["red", "green", "blue", "opacity"],
    };
    let text = format!("{}: {}", picture.channels, names.join(", "));
    section.fact("channels", text, json!(names));
    let bits = match picture.samples {
        Samples::U8(_) => 8,
        Samples::U16(_) => 16,
        Samples::F32(_) => 32,
    };
    section.plain("bits", bits);
    let bounds: Vec<_> = (0..picture.channels).map(|channel| bounds(&picture, channel)).collect();
    for (name, [least, most]) in names.iter().zip(&bounds) {
        let text = format!("from {} to {}", number(*least), number(*most));
        section.fact(*name, text, json!([least, most]));
    }
    let is_clear = bounds.last().is_some_and(|[_, most]| *most == 0.0);
    if picture.opacity().is_some() && is_clear {
        findings.problem("an image shows something, and the opacity of this is 0 everywhere");
    }
    add_masks(&mut section, &picture, &location);
    findings.whole(section);
    for remark in Picture::remarks(&bytes, &location)? {
        findings.note(remark);
    }
    Ok(findings)
}

/// Adds the masks that an image has, and what it says as a mask itself.
fn add_masks(section: &mut Section, picture: &Picture, location: &Location) {
    match picture.opacity() {
        None => {
            section.fact("masks", "none: it has no opacity", Value::Null);
        }
        Some(opacity) => {
            let opaque = opacity.data().iter().filter(|&&share| share > 0.5).count();
            let share = opaque as f64 / picture.pixels() as f64;
            let text = format!("{} of the pixels are more opaque than not", percent(share));
            section.fact("masks", text, json!({ "share": share }));
        }
    }
    match Mask::from_picture(picture, location) {
        Ok(mask) if mask.kind != MaskKind::Even => {
            let text =
                format!("{} of the pixels are the object, by {}", percent(mask.mean()), mask.kind);
            let value = json!({ "share": mask.mean(), "by": mask.kind.to_string() });
            section.fact("as a mask", text, value);
        }
        // Larger than the process may have: nothing is known.
        Err(error @ SceneError::Memory { .. }) => {
            section.fact("as a mask", error, Value::Null);
        }
        _ => {
            section.fact("as a mask", "it tells no objects from background", Value::Null);
        }
    }
}

/// The least and the largest sample of a channel, as the file has them.
fn bounds(picture: &Picture, channel: usize) -> [f64; 2] {
    fn extent_of<S: Copy + Into<f64>>(samples: &[S], first: usize, step: usize) -> [f64; 2] {
        let samples = samples.iter().skip(first).step_by(step).map(|&sample| sample.into());
        samples.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)])
    }
    match &picture.samples {
        Samples::U8(samples) => extent_of(samples, channel, picture.channels),
        Samples::U16(samples) => extent_of(samples, channel, picture.channels),
        Samples::F32(samples) => extent_of(samples, channel, picture.channels),
    }
}
