//! What is learnt, how, and when it ends.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::numbers::{
    CellCount, Count, NotNegative, PassCount, Positive, Share, StartCount, TextureSize,
};

/// What is learnt. What is absent stays as it is and costs no gradient.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Learn {
    /// Shapes whose topology changes: the numbers of a field at the points of a grid.
    pub field: Option<LearnField>,
    /// The places of vertices. Their rate is a share of the mesh's radius.
    pub vertices: Option<LearnVertices>,
    /// Colours at vertices.
    pub colors: Option<LearnObjects>,
    /// Textures of base colours.
    pub texture: Option<LearnMaps>,
    /// Roughness of surfaces.
    pub roughness: Option<LearnMaps>,
    /// How metallic surfaces are.
    pub metallic: Option<LearnMaps>,
    /// Where meshes stand. The rate of rotations is in radians, and of translations a share of the scene's
    /// radius.
    pub pose: Option<LearnPose>,
    /// Where cameras stand, as `pose`.
    pub cameras: Option<LearnNumbers>,
    /// Focal lengths and principal points: all views change alike, by shares of their focal lengths and of
    /// their widths.
    pub intrinsics: Option<LearnNumbers>,
    /// Coefficients of the lens, one set for all views; it starts from the first view's.
    pub distortion: Option<LearnNumbers>,
    /// Colours of lights.
    pub lights: Option<LearnNumbers>,
    /// Directions of lights, and places of points: the rate of these is a share of the scene's radius.
    pub light_places: Option<LearnNumbers>,
    /// Light from all sides.
    pub environment: Option<LearnNumbers>,
    /// How much light is multiplied: of all views alike, or of each view.
    pub exposure: Option<LearnExposure>,
    /// The standard deviation of the blur.
    pub blur: Option<LearnNumbers>,
    /// The lens: its aperture or radius, and its focus. What a view gives of its own is learnt of that view. Rates
    /// are shares.
    pub lens: Option<LearnLens>,
}

/// How numbers of the whole scene are learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnNumbers {
    /// The learning rate.
    pub rate: Option<Positive>,
}

/// How exposures are learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnExposure {
    /// The learning rate.
    pub rate: Option<Positive>,
    /// Whether each view learns how its exposure differs from the mean, which stays; by default the exposure of all
    /// views is learnt.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub per_view: bool,
}

/// How numbers of meshes are learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnObjects {
    /// The learning rate.
    pub rate: Option<Positive>,
    /// The meshes that this is about; by default all.
    pub meshes: Option<Vec<String>>,
}

/// How places of meshes are learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnPose {
    /// The learning rate.
    pub rate: Option<Positive>,
    /// The meshes that this is about; by default all.
    pub meshes: Option<Vec<String>>,
    /// So many rotations of each mesh are tried on small images before the fit begins, which starts from the best.
    pub starts: Option<StartCount>,
}

/// How maps are learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnMaps {
    /// The learning rate.
    pub rate: Option<Positive>,
    /// The meshes that this is about; by default all.
    pub meshes: Option<Vec<String>>,
    /// The weight of the total variation in the loss, of meshes with a map.
    pub total_variation: Option<Positive>,
}

/// How a lens is learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnLens {
    /// The learning rate.
    pub rate: Option<Positive>,
    /// What each view has of its own, whether it gives it or not.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub per_view: Vec<LensNumber>,
}

/// A number of a lens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LensNumber {
    /// The radius of the circle of confusion at infinite distance.
    Aperture,
    /// The radius of the lens.
    Radius,
    /// The distance that is sharp.
    Focus,
}

/// How places of vertices are learnt.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnVertices {
    /// The learning rate, as a share of the mesh's radius.
    pub rate: Option<Positive>,
    /// The meshes that this is about; by default all.
    pub meshes: Option<Vec<String>>,
    /// How smooth steps are: lambda of large steps. Absent, each vertex steps alone.
    pub smoothing: Option<Positive>,
    /// The weight in the loss of what is not rigid in how the mesh changes.
    pub rigid: Option<Positive>,
    /// The weight of the Laplacian in the loss.
    pub laplacian: Option<Positive>,
    /// The weight of edge lengths in the loss.
    pub edge_length: Option<Positive>,
    /// The weight of angles between neighbouring faces in the loss.
    pub normals: Option<Positive>,
}

/// How fields are learnt whose surfaces are meshes.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LearnField {
    /// The learning rate, in cells of the grid.
    pub rate: Option<Positive>,
    /// The meshes that this is about; by default all.
    pub meshes: Option<Vec<String>>,
    /// Cells along the longest side of the grid, from 4 to 512; by default 48.
    pub cells: Option<CellCount>,
    /// How many times the field is smoothed, up to 16; by default 2.
    pub smoothing: Option<PassCount>,
}

/// What a fit makes small.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LossEntry {
    /// What counts of the difference of two pixels.
    #[serde(default)]
    pub kind: LossKind,
    /// The weight of masks beside colours. It needs opacity or masks of the views.
    pub silhouette: Option<NotNegative>,
    /// The weight of structure (1 - SSIM) beside the difference of pixels.
    pub ssim: Option<Share>,
}

/// What counts of the difference of two pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LossKind {
    /// Its square.
    #[default]
    Squared,
    /// Its absolute value.
    Absolute,
    /// Its square near 0, its absolute value beyond 0.1.
    Huber,
}

/// A part of a fit. What it does not say is as in the whole.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stage {
    /// How many steps.
    pub steps: Count,
    /// What is learnt, names from `learn`; by default all of it.
    pub learn: Option<Vec<String>>,
    /// Images are made smaller so many times along each axis.
    pub reduce: Option<Count>,
    /// How many views each step sees; by default 1.
    pub views_per_step: Option<Count>,
    /// What all rates are multiplied by.
    pub rates: Option<Positive>,
    /// Gives meshes whose vertices are learnt other vertices and faces, at the start of the stage and now and then.
    pub remesh: Option<Remesh>,
    /// Gives meshes whose colours are learnt at vertices a texture at the start of the stage, which is learnt from then
    /// on.
    pub texture: Option<StageTexture>,
}

/// How meshes get other vertices and faces. Their topology stays, and what was learnt is carried over.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Remesh {
    /// How long edges are to be, as a share of the mesh's radius.
    pub length: Positive,
    /// Again after so many steps each; absent, once.
    pub every: Option<Count>,
}

/// The texture that meshes get. It begins with their colours.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageTexture {
    /// The texels along each side, a power of two.
    pub size: TextureSize,
}

/// When a fit ends.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StopEntry {
    /// After so many steps, where there are no stages; by default 1000.
    pub steps: Option<Count>,
    /// How many views each step sees, where there are no stages; by default 1.
    pub views_per_step: Option<Count>,
    /// After so many seconds.
    pub seconds: Option<Positive>,
    /// Below this loss.
    pub loss_below: Option<Positive>,
    /// Ends a stage, and with the last one the fit, after so many steps without a smaller loss.
    pub patience: Option<Count>,
    /// Ends a stage, and with the last one the fit, by views that are held out.
    pub held_out: Option<HeldOutEntry>,
}

/// When views that are held out say that a stage is done.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeldOutEntry {
    /// They are measured after so many steps each.
    pub every: Count,
    /// The stage ends after so many measures that were no better than the best before.
    pub patience: Count,
    /// Better is by more decibels of PSNR than this; by default 0.
    pub gain: Option<NotNegative>,
}
