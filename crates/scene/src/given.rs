//! What a fit of a scene was given: its files and settings, each in words. So a resumed fit names what was
//! changed meanwhile, and ranks of a job what they have not in common.

use std::collections::BTreeSet;
use std::path::PathBuf;

use bokashi_core::Tensor;
use bokashi_fit::{Alone, Communicator, FitError, Given, Parameters, agree, block, check_alike};

use crate::object::Object;
use crate::scene::{Scene, SceneView};

impl Scene {
    /// The scene's files and settings by name: all keys of `scene.toml` as `learn.vertices.rate`, each file's
    /// length and checksum, each mesh and view as it is in memory. It reads all images of the scene once.
    ///
    /// Of a file that can't be read it says so, and who needs it says why.
    pub fn given(&self) -> Given {
        self.given_among(&Alone).expect("one rank is like itself")
    }

    /// As [`Scene::given`], of a fit that ranks share, which all were given the same. Each image is read by two of
    /// them: by the one whose steps need it, and by one that compares.
    ///
    /// # Errors
    /// [`FitError::Unlike`], on all ranks.
    pub(crate) fn given_among(&self, ranks: &dyn Communicator<f32>) -> Result<Given, FitError> {
        let mut given = self.given_but_images();
        check_alike(ranks, &given)?;
        let images: BTreeSet<_> =
            self.views.iter().flat_map(|view| [&view.image, &view.mask]).flatten().collect();
        let images: Vec<&PathBuf> = images.into_iter().collect();
        let (rank, size) = (ranks.rank(), ranks.size());
        let digest = |file: &&PathBuf| match self.folder.digest(file) {
            Ok(said) => said,
            Err(_) => "nothing that can be read".to_owned(),
        };
        let said = |rank| images[block(images.len(), rank, size)].iter().map(digest);
        // Alone there is nobody to compare with.
        let others = (size > 1).then(|| said((rank + 1) % size)).into_iter().flatten();
        let words: Vec<_> = said(rank).chain(others).collect();
        let all = agree::<_, FitError>(ranks, Ok(words.join("\n").into_bytes()))?;
        let all: Vec<_> = all.iter().map(|words| String::from_utf8_lossy(words)).collect();
        for rank in 0..size {
            let own = &images[block(images.len(), rank, size)];
            let before = (rank + size - 1) % size;
            let skipped = block(images.len(), before, size).len();
            let compared = all[before].lines().skip(if size > 1 { skipped } else { 0 });
            for ((file, own), other) in own.iter().zip(all[rank].lines()).zip(compared) {
                let name = file.display().to_string();
                if own != other {
                    let (own, other) = (own.to_owned(), other.to_owned());
                    return Err(FitError::Unlike {
                        name,
                        ranks: [rank, before],
                        values: [own, other],
                    });
                }
                given.insert(name, own.to_owned());
            }
        }
        Ok(given)
    }

    fn given_but_images(&self) -> Given {
        let keys = self.description.keys().into_iter();
        let mut given: Given = keys.map(|(key, value)| (format!("`{key}`"), value)).collect();
        given.extend(self.files.clone());
        given.extend(self.objects.iter().map(|own| (format!("mesh {:?}", own.name), mesh(own))));
        given.extend(self.views.iter().map(|own| (format!("view {:?}", own.name), view(own))));
        given
    }
}

/// A mesh as it is in memory, where a program may have changed it.
fn mesh(object: &Object) -> String {
    let mut hasher = crc32fast::Hasher::new();
    let colors = object.colors.as_ref().map(|colors| &colors.rows);
    for tensor in [Some(&object.positions), colors].into_iter().flatten() {
        add(&mut hasher, tensor);
    }
    hasher.update(format!("{:?}", object.places).as_bytes());
    let (vertices, faces) = (object.mesh.vertex_count(), object.mesh.faces().len());
    format!("{vertices} vertices, {faces} faces, checksum {:08x}", hasher.finalize())
}

fn view(view: &SceneView) -> String {
    let SceneView { name: _, image, mask, color_space, held_out, camera } = view;
    let numbers = crc32fast::hash(format!("{camera:?}").as_bytes());
    let mut said = format!("camera with checksum {numbers:08x}");
    for (what, file) in [("image", image), ("mask", mask)] {
        if let Some(file) = file {
            said += &format!(", {what} {}", file.display());
        }
    }
    if let Some(space) = color_space {
        said += &format!(", {space:?}");
    }
    said + if *held_out { ", held out" } else { "" }
}

/// What parameters are in words, each by its name.
pub(crate) fn starts(parameters: &Parameters<f32>) -> Given {
    let of = |tensor: &Tensor<f32>| {
        let mut hasher = crc32fast::Hasher::new();
        add(&mut hasher, tensor);
        let listed =
            if tensor.size() <= 6 { format!("{:?}, ", tensor.data()) } else { String::new() };
        format!("{listed}shape {}, checksum {:08x}", tensor.shape(), hasher.finalize())
    };
    let all = parameters.iter();
    all.map(|own| (format!("the start of {:?}", own.name()), of(&own.value()))).collect()
}

fn add(hasher: &mut crc32fast::Hasher, tensor: &Tensor<f32>) {
    hasher.update(format!("{}", tensor.shape()).as_bytes());
    tensor.data().iter().for_each(|x| hasher.update(&x.to_le_bytes()));
}
