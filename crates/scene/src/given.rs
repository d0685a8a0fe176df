//! What a fit of a scene was given: its files and settings, each in words. So a resumed fit names what was
//! changed meanwhile, and ranks of a job what they have not in common.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use bokashi_core::Tensor;
use bokashi_fit::{Alone, Communicator, FitError, Given, Parameters, agree, block, check_alike};

use crate::description::ViewLens;
use crate::object::Object;
use crate::scene::Scene;
use crate::scene_view::SceneView;

/// Starts of poses are tried on so many views: more would tell little more, and take more time.
const MOST_SEARCHED: usize = 4;

impl Scene {
    /// The scene's files and settings by name: all keys of `scene.toml` as `learn.vertices.rate`, each file's
    /// length and checksum, each mesh and view as it is in memory. It reads all images of the scene once.
    ///
    /// Of a file that can't be read it says so, and who needs it says why.
    pub fn given(&self) -> Given {
        self.given_among(&Alone).expect("one rank is like itself")
    }

    /// As [`Scene::given`], of a fit that ranks share, which all were given the same. An image is read by the
    /// ranks that need it, in steps or to measure and draw its view, and by the rank before each of them.
    ///
    /// # Errors
    /// [`FitError::Unlike`], on all ranks.
    pub(crate) fn given_among(&self, ranks: &dyn Communicator<f32>) -> Result<Given, FitError> {
        let mut given = self.given_but_images();
        check_alike(ranks, &given)?;
        let (rank, size) = (ranks.rank(), ranks.size());
        let mut files = self.needed_by(rank, size);
        files.extend(self.needed_by((rank + 1) % size, size));
        let line = |file: &&PathBuf| match self.folder.digest(file) {
            Ok(digest) => format!("{}\0{digest}\0", file.display()),
            Err(_) => format!("{}\0nothing that can be read\0", file.display()),
        };
        let words: String = files.iter().map(line).collect();
        let all = agree::<_, FitError>(ranks, Ok(words.into_bytes()))?;
        let mut known = BTreeMap::new();
        for (rank, words) in all.iter().enumerate() {
            let words: Vec<_> = words.split(|&byte| byte == 0).collect();
            for pair in words.chunks_exact(2) {
                let [file, digest] =
                    [pair[0], pair[1]].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
                let (first, before) = known.entry(file.clone()).or_insert((rank, digest.clone()));
                if *before != digest {
                    let (ranks, values) = ([rank, *first], [digest, before.clone()]);
                    return Err(FitError::Unlike { name: file, ranks, values });
                }
            }
        }
        given.extend(known.into_iter().map(|(file, (_, digest))| (file, digest)));
        Ok(given)
    }

    /// The views on which starts of poses are tried, by all ranks: a few of those that are learnt from, of all parts of
    /// their list. None where no pose has several starts.
    pub(crate) fn searched_views(&self) -> Vec<usize> {
        let starts = self.description.learn.pose.as_ref().and_then(|pose| pose.starts);
        let all: Vec<_> = self.views_with_image(false).filter(|_| starts.is_some()).collect();
        let count = all.len().min(MOST_SEARCHED);
        (0..count).map(|k| all[k * all.len() / count]).collect()
    }

    /// The images and masks that a rank reads: of its views in steps, of those it measures, and of those it draws; and
    /// those that all ranks read.
    fn needed_by(&self, rank: usize, size: usize) -> BTreeSet<&PathBuf> {
        let shared = |is_own: fn(&SceneView) -> bool| {
            let views: Vec<_> = self.views.iter().filter(|view| is_own(view)).collect();
            views[block(views.len(), rank, size)].to_vec()
        };
        let learnt_from = shared(|view| view.image.is_some() && !view.held_out);
        let held_out = shared(|view| view.image.is_some() && view.held_out);
        let views = learnt_from.into_iter().chain(held_out).chain(shared(|_| true));
        let views = views.chain(self.searched_views().into_iter().map(|view| &self.views[view]));
        views.flat_map(|view| [&view.image, &view.mask]).flatten().collect()
    }

    fn given_but_images(&self) -> Given {
        let keys = self.description.keys().into_iter();
        let mut given: Given = keys.map(|(key, value)| (format!("`{key}`"), value)).collect();
        given.extend(self.files.clone());
        given.extend(
            self.objects.iter().map(|object| (format!("mesh {:?}", object.name), mesh(object))),
        );
        given.extend(self.views.iter().map(|x| (format!("view {:?}", x.name), view(x))));
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
    let SceneView { name: _, image, mask, color_space, held_out, exposure, camera, lens } = view;
    let numbers = crc32fast::hash(format!("{camera:?}").as_bytes());
    let mut digest = format!("camera with checksum {numbers:08x}");
    for (what, file) in [("image", image), ("mask", mask)] {
        if let Some(file) = file {
            digest += &format!(", {what} {}", file.display());
        }
    }
    if let Some(space) = color_space {
        digest += &format!(", {space:?}");
    }
    if *exposure != 0.0 {
        digest += &format!(", exposure {exposure}");
    }
    if *lens != ViewLens::default() {
        digest += &format!(", {lens:?}");
    }
    digest + if *held_out { ", held out" } else { "" }
}

/// What parameters are in words, each by its name.
pub(crate) fn starts(parameters: &Parameters<f32>) -> Given {
    let described = |tensor: &Tensor<f32>| {
        let mut hasher = crc32fast::Hasher::new();
        add(&mut hasher, tensor);
        let listed =
            if tensor.size() <= 6 { format!("{:?}, ", tensor.data()) } else { String::new() };
        format!("{listed}shape {}, checksum {:08x}", tensor.shape(), hasher.finalize())
    };
    let all = parameters.iter();
    all.map(|parameter| {
        (format!("the start of {:?}", parameter.name()), described(&parameter.value()))
    })
    .collect()
}

fn add(hasher: &mut crc32fast::Hasher, tensor: &Tensor<f32>) {
    hasher.update(format!("{}", tensor.shape()).as_bytes());
    tensor.data().iter().for_each(|x| hasher.update(&x.to_le_bytes()));
}
