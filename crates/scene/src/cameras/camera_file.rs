//! What a file of cameras holds.

use std::collections::BTreeMap;

use bokashi_render_ops::Size;

use super::camera::NamedView;
use crate::folder::Folder;
use crate::picture::Picture;

/// The most times that images are smaller than their cameras. For more, rounded sizes would fit by chance.
const MOST_TIMES: usize = 8;

/// What a file of cameras holds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraFile {
    /// Its views.
    pub views: Vec<NamedView>,
    /// What was left out or mended, in words.
    pub notes: Vec<String>,
}

impl CameraFile {
    /// Scales the cameras of images that are smaller than they by a whole factor, as those of folders `images_2`
    /// to `images_8`, and notes it. What else is wrong with an image is found when it is decoded.
    pub(super) fn sized(mut self, folder: &Folder) -> Self {
        let mut counts = BTreeMap::new();
        let mut first = None;
        for view in &mut self.views {
            let Ok([width, height]) = Picture::read_size(folder, &view.image) else { continue };
            let (size, old) = (Size { width, height }, view.camera.size);
            let Some(times) = times_smaller(old, size) else { continue };
            view.camera = view.camera.resized(size);
            first.get_or_insert((view.name.clone(), old, size));
            *counts.entry(times).or_insert(0_usize) += 1;
        }
        let Some((name, old, size)) = first else { return self };
        let counts: Vec<_> = counts
            .iter()
            .map(|(times, count)| match count {
                1 => format!("1 image is {times} times smaller than its camera"),
                _ => format!("{count} images are {times} times smaller than their cameras"),
            })
            .collect();
        let example = format!(
            "{name:?} is {} x {}, and its camera {} x {}",
            size.width, size.height, old.width, old.height
        );
        let rule = "focal lengths and principal points are scaled with them";
        self.notes.push(format!("{}, and {rule}: {example}", counts.join(", ")));
        self
    }
}

/// How many times smaller than its camera an image is, rounded in any way.
fn times_smaller(camera: Size, image: Size) -> Option<usize> {
    let pairs = [(camera.width, image.width), (camera.height, image.height)];
    let is_of = |times: usize| {
        pairs.iter().all(|&(old, new)| (old / times..=old.div_ceil(times)).contains(&new))
    };
    let is_smaller =
        pairs.iter().any(|(old, new)| new < old) && pairs.iter().all(|(_, new)| *new > 0);
    (2..=MOST_TIMES).find(|&times| is_smaller && is_of(times))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_may_be_rounded_in_any_way() {
        let size = |[width, height]: [usize; 2]| Size { width, height };
        for (camera, image, times) in [
            ([128, 96], [32, 24], Some(4)),
            ([4946, 3286], [1237, 822], Some(4)),
            ([4946, 3286], [1236, 821], Some(4)),
            ([4946, 3286], [618, 411], Some(8)),
            ([101, 77], [50, 39], Some(2)),
            ([128, 96], [24, 32], None),
            ([128, 96], [128, 96], None),
            ([128, 96], [85, 64], None),
            ([128, 96], [256, 192], None),
            ([1, 1], [1, 1], None),
            ([128, 128], [8, 8], None),
        ] {
            assert_eq!(times_smaller(size(camera), size(image)), times, "{camera:?} {image:?}");
        }
    }
}
