//! The meshes of a scene: the part, fixtures around it, each `FILE[@STEPS]`, and the stock it is cut from.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::str::FromStr as _;

use anyhow::{Context as _, Result};
use glam::{DMat4, DVec3};
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::mesh::read::{MeshFile, read_mesh_file};
use imf_core::mesh::topology::MeshReport;
use imf_core::mesh::{FaceRepair, Mesh};
use imf_core::occupancy::Occupancy;
use imf_core::parts::ReferencePart;
use imf_core::scene::{SceneWarning, solid_voxels};
use imf_core::unit::{LengthUnit, UnknownUnit};
use imf_core::voxelize::VoxelizeResult;

use super::numbers::parse_room;
use super::scene::warn_of;
use super::transform::parse_transform;
use crate::exit::WrongArgument;
use crate::output::{short, show_measure};
use crate::session::Session;

/// A part as read, before it is voxelised.
pub(crate) struct Part {
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    pub(crate) unit: LengthUnit,
    pub(crate) reference: Option<ReferencePart>,
    /// True where the unit is given, or the file's own; false where it is assumed.
    pub(crate) unit_is_known: bool,
    /// The file's own unit, where another one was given.
    pub(crate) overruled: Option<LengthUnit>,
    /// What was done to make its triangles face consistently.
    pub(crate) repair: FaceRepair,
}

impl Part {
    /// Reads a file or makes a built-in part. A file of that name wins over a built-in part, a folder does not. An STL file, which
    /// does not say its unit, is in the `assumed` one, or asks for it.
    pub(crate) fn read(part: &str, given: Option<LengthUnit>, assumed: Option<LengthUnit>) -> Result<Self> {
        let path = Path::new(part);
        if !path.is_file()
            && let Ok(reference) = ReferencePart::from_str(part)
        {
            return Ok(Self {
                name: reference.name().into(),
                mesh: reference.mesh(),
                unit: LengthUnit::Mm,
                reference: Some(reference),
                unit_is_known: true,
                overruled: None,
                repair: FaceRepair::default(),
            });
        }
        let is_stl = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl"));
        if is_stl && given.or(assumed).is_none() && path.exists() {
            let why = format!("{part}: an STL file does not say its unit; add --unit mm (or cm, m, inch)");
            return Err(WrongArgument(why).into());
        }
        let MeshFile { mesh, unit: stated } = read_mesh_file(path)?;
        let (mesh, repair) = mesh.with_consistent_faces();
        let name = path.file_name().map_or_else(|| part.to_owned(), |n| n.to_string_lossy().into_owned());
        Ok(Self {
            name,
            mesh,
            unit: given.or(stated).or(assumed).unwrap_or_default(),
            reference: None,
            unit_is_known: given.or(stated).is_some(),
            overruled: stated.filter(|stated| given.is_some_and(|given| given != *stated)),
            repair,
        })
    }

    /// The part with its coordinates multiplied.
    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        if factor != 1.0 {
            self.mesh = self.mesh.transformed(&DMat4::from_scale(DVec3::splat(factor)));
        }
        self
    }
}

/// What was typed of a fixture: `FILE` or `FILE@STEPS`.
#[derive(Clone, Debug)]
pub struct FixtureArgument {
    pub(super) file: String,
    /// The file's, where a step names it.
    unit: Option<LengthUnit>,
    transform: DMat4,
}

impl FixtureArgument {
    /// What it is (`what` in messages) around a part in `unit`: scaled where its unit is known to be another.
    fn read(&self, what: &str, unit: LengthUnit) -> Result<Part> {
        let part = Part::read(&self.file, self.unit, Some(unit))
            .with_context(|| format!("the {what} cannot be used"))?;
        let factor = if part.unit_is_known { part.unit.in_mm() / unit.in_mm() } else { 1.0 };
        Ok(Part { unit, ..part.scaled(factor) })
    }
}

/// The steps are those of a set-up, and `unit:UNIT` of the file.
pub(super) fn parse_fixture(text: &str) -> Result<FixtureArgument, String> {
    // A folder's name may hold the sign too.
    let is_file = |name: &str| Path::new(name).is_file();
    let by_file = || {
        text.rmatch_indices('@').map(|(at, _)| (&text[..at], &text[at + 1..])).find(|(file, _)| is_file(file))
    };
    let whole = is_file(text).then_some((text, ""));
    let (file, steps) = whole.or_else(by_file).or_else(|| text.split_once('@')).unwrap_or((text, ""));
    let (mut unit, mut others) = (None, Vec::new());
    for step in steps.split(';') {
        match step.trim().strip_prefix("unit:") {
            Some(name) => unit = Some(name.parse().map_err(|error: UnknownUnit| error.to_string())?),
            None => others.push(step),
        }
    }
    Ok(FixtureArgument { file: file.to_owned(), unit, transform: parse_transform(&others.join(";"))? })
}

/// What was typed of the stock.
#[derive(Clone, Debug)]
pub(crate) enum StockArgument {
    /// `box`, or `box:MARGIN`: the part's box with a margin around it, in its unit.
    Box(f64),
    /// A file in the part's frame, which is set up as the part is, after steps of its own as a fixture has them.
    File(FixtureArgument),
}

pub(super) fn parse_stock(text: &str) -> Result<StockArgument, String> {
    match text.split_once(':') {
        _ if text == "box" => Ok(StockArgument::Box(0.0)),
        Some(("box", margin)) => parse_room(margin).map(StockArgument::Box),
        _ => parse_fixture(text).map(StockArgument::File),
    }
}

/// A fixture as read; where its unit is not known it is taken to be in the part's.
pub(crate) struct FixtureMesh {
    pub(crate) body: Part,
    pub(crate) transform: DMat4,
}

impl FixtureMesh {
    /// Lengths are in the part's unit, `part_unit`, unless a step or the file says otherwise.
    pub(crate) fn read(argument: &FixtureArgument, part_unit: LengthUnit) -> Result<Self> {
        Ok(Self { body: argument.read("fixture", part_unit)?, transform: argument.transform })
    }
}

/// The stock as read, in the world.
pub(crate) struct Stock {
    /// For people.
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    repair: FaceRepair,
    /// That of the part.
    unit: LengthUnit,
    /// The pitch of the voxels of which a path's check left it so, in the part's unit.
    left_by: Option<f64>,
}

/// Relative difference of volumes by voxels and by meshes above which a warning is given.
const DIFFERENCE: f64 = 0.02;

/// Fraction of a stock, and of the part in its box, that may lie in the other where the stock stands beside the part.
const MOST_WITHIN: f64 = 0.01;

/// Of such a stock.
pub(crate) const BESIDE: &str =
    "stands beside the part, as supports do: if it should hold the part, check where it stands, and its unit";

/// Cosine of the angle to an axis within which a voxel's face stands along it, in a file of single precision.
const ALONG_AXES: f64 = 0.999;

/// Before the pitch of the voxels in the comment of what a path's check leaves of a stock.
pub(crate) const BY_VOXELS: &str = "by voxels of ";

/// That pitch, and its unit; `None` of other files.
fn left_by(path: &Path) -> Option<(f64, LengthUnit)> {
    let mut head = [0; 80];
    File::open(path).ok()?.read_exact(&mut head).ok()?;
    let text = String::from_utf8_lossy(&head);
    let mut words = text.split_once(BY_VOXELS)?.1.split_whitespace();
    Some((words.next()?.parse().ok()?, words.next()?.trim_end_matches('\0').parse().ok()?))
}

impl Stock {
    /// Warns where what it holds beside the part, by voxels, is not what it is by the meshes; also gets a voxel's volume.
    pub(crate) fn compare_volumes(
        &self,
        session: &Session,
        [beside, voxel]: [f64; 2],
        part: &Mesh,
        unit: LengthUnit,
    ) {
        // Of what is not one closed piece it is not known what it holds.
        let volume = |mesh: &Mesh| {
            let report = MeshReport::new(mesh);
            (report.closed && report.components == 1).then(|| report.signed_volume.abs())
        };
        if let (Some(whole), Some(own)) = (volume(&self.mesh), volume(part))
            && ((whole - own) - beside).abs() > (DIFFERENCE * (whole - own)).max(voxel)
        {
            session.warn(&format!(
                "the stock beside the part is {} {unit}³ by its voxels and {} {unit}³ by the meshes: a layer thinner than a voxel counts as \
                 a whole one or not at all, and a face through the voxels' centres to one side; a smaller pitch brings both together",
                show_measure(beside),
                show_measure((whole - own).max(0.0))
            ));
        }
    }

    /// Whether its faces do, as those of voxels.
    fn lies_along_axes(&self) -> bool {
        let corners = |triangle: &[u32; 3]| triangle.map(|vertex| self.mesh.vertices[vertex as usize]);
        self.mesh.triangles.iter().map(corners).all(|[a, b, c]| {
            let normal = (b - a).cross(c - a);
            normal.abs().max_element() >= ALONG_AXES * normal.length()
        })
    }

    /// The stock of a part whose box is `part_box`; `transform` sets the part up.
    pub(crate) fn read(
        argument: &StockArgument,
        part_box: (DVec3, DVec3),
        transform: &DMat4,
        part_unit: LengthUnit,
    ) -> Result<Self> {
        let argument = match argument {
            StockArgument::Box(margin) => {
                let mesh = Mesh::cuboid(part_box.0 - *margin, part_box.1 + *margin);
                let around =
                    if *margin > 0.0 { format!(" and {margin} {part_unit} around") } else { String::new() };
                let name = format!("the part's box{around}");
                return Ok(Self {
                    name,
                    mesh,
                    repair: FaceRepair::default(),
                    unit: part_unit,
                    left_by: None,
                });
            }
            StockArgument::File(argument) => argument,
        };
        let file = argument.read("stock", part_unit)?;
        let mesh = file.mesh.transformed(&(*transform * argument.transform));
        let left_by = left_by(Path::new(&argument.file));
        let left_by = left_by.map(|(pitch, unit)| pitch * unit.in_mm() / part_unit.in_mm());
        Ok(Self { name: file.name, mesh, repair: file.repair, unit: part_unit, left_by })
    }

    /// Its voxels on a grid. A mesh that does not say what is inside is refused, and one that hardly does is warned of.
    pub(crate) fn voxels(&self, session: &Session, grid: &Grid, control: Control<'_>) -> Result<Occupancy> {
        warn_of(session, &SceneWarning::of_repair(&self.name, &self.repair, self.mesh.triangles.len()));
        if let Some(pitch) = self.left_by.filter(|pitch| *pitch > grid.pitch * (1.0 + 1e-6)) {
            session.warn(&format!(
                "the stock '{}' is what was left by voxels of {}, larger than those of now: its faces lie up to {} from where the cutter \
                 passed, and what touches it less deep may be missed; follow all programs at one pitch",
                self.name,
                short(pitch),
                short(0.75_f64.sqrt() * pitch)
            ));
        }
        if let Some(pitch) = self.left_by.filter(|_| !self.lies_along_axes()) {
            session.warn(&format!(
                "the stock '{}' is what was left by voxels that stand askew here: its faces are steps of theirs, and a cutter that goes \
                 where one went before may touch them up to {} deep; follow all programs of a set-up before the part is turned, and take a \
                 smaller pitch",
                self.name,
                short(0.75_f64.sqrt() * pitch)
            ));
        }
        let VoxelizeResult { solid, undecided } = solid_voxels(&self.name, &self.mesh, grid, false, control)?;
        if undecided > 0.0 {
            session.warn(&format!(
                "the stock '{}' is open: of {:.0} % of the voxel centres in it or near it its surface hardly says whether they are inside",
                self.name,
                (100.0 * undecided).ceil()
            ));
        }
        let lost = SceneWarning::of_lost_surface(&self.name, &self.mesh, &solid, grid, self.unit);
        if let Some(SceneWarning::Lost { area, fraction, at, pitch, unit, .. }) = lost {
            session.warn(&format!(
                "the stock '{}': {} {unit}² of its surface ({:.1} %), as at ({}), is of walls or layers so thin that they lie between the \
                 centres of voxels of {} {unit}: these are no stock, and whatever cuts them is not seen; choose a smaller pitch",
                self.name,
                show_measure(area),
                100.0 * fraction,
                at.to_array().map(short).join(", "),
                short(pitch)
            ));
        }
        Ok(solid)
    }

    /// Whether a stock stands beside the part, as supports do: it holds hardly anything of it, and touches it.
    pub(crate) fn is_beside(stock: &Occupancy, part: &Occupancy) -> bool {
        // With a layer around it, in which lies what it touches; it holds no stock, so that no pair wraps from one row to the next.
        let both = |around: Grid| Some((stock.on(&around)?, part.on(&around)?));
        let both = stock.grid.padded([1; 3], [1; 3]).ok().and_then(both);
        let Some((stock, part)) = both else { return false };
        let within =
            stock.solid.iter().zip(&part.solid).filter(|(stock, part)| **stock & **part == 1).count();
        let [_, ny, nz] = stock.grid.dims;
        let touches = |stride: usize| {
            let pairs = || stock.solid.iter().zip(&part.solid[stride.min(part.solid.len())..]);
            let back = || part.solid.iter().zip(&stock.solid[stride.min(stock.solid.len())..]);
            pairs().chain(back()).any(|(one, other)| one & other == 1)
        };
        let least = stock.count().min(part.count()) as f64;
        within as f64 <= MOST_WITHIN * least && [ny * nz, nz, 1].into_iter().any(touches)
    }
}

#[cfg(test)]
mod tests {
    use imf_core::mesh::write::write_obj;

    use super::*;

    #[test]
    fn a_box_of_stock_stands_around_the_part() {
        let part = (DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0));
        let read =
            |text: &str| Stock::read(&parse_stock(text).unwrap(), part, &DMat4::IDENTITY, LengthUnit::Mm);
        let stock = read("box:0.5").unwrap();
        assert!((stock.mesh.signed_volume() - 2.0 * 3.0 * 4.0).abs() < 1e-9);
        assert!(read("no such file.obj").is_err());
        for text in ["box:-1", "box:x", "box:nan", "bracket@scale:2"] {
            assert!(parse_stock(text).is_err(), "{text}");
        }
    }

    #[test]
    fn supports_stand_beside_a_part_and_a_stock_that_is_misplaced_does_not() {
        let grid = |low: f64, dims| Grid { origin: DVec3::splat(low), pitch: 1.0, dims };
        let full = |grid: Grid| Occupancy { solid: vec![1; grid.len()], grid };
        let part = full(grid(0.0, [10, 10, 4]));
        let at = |x: f64, y: f64, z: f64, dims| full(Grid { origin: DVec3::new(x, y, z), ..grid(0.0, dims) });
        assert!(Stock::is_beside(&at(2.0, 2.0, 4.0, [3, 3, 8]), &part));
        assert!(Stock::is_beside(&at(-3.0, 2.0, 0.0, [3, 3, 3]), &part));
        for elsewhere in [
            at(-30.0, -30.0, -30.0, [70, 70, 64]),
            at(2.0, 2.0, 5.0, [3, 3, 8]),
            at(2.0, 2.0, 1.0, [3, 3, 2]),
            at(-2.0, -2.0, -2.0, [14, 14, 14]),
            at(10.0, 10.0, 0.0, [3, 3, 3]),
        ] {
            assert!(!Stock::is_beside(&elsewhere, &part), "{:?}", elsewhere.grid);
        }
    }

    #[test]
    fn a_file_of_stock_has_a_unit_and_steps_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bar.obj");
        write_obj(&Mesh::cuboid(DVec3::ZERO, DVec3::ONE), &file, "").unwrap();
        let part = (DVec3::ZERO, DVec3::splat(20.0));
        let text = format!("{}@unit:inch; translate:0,0,1", file.display());
        let up = DMat4::from_translation(DVec3::Y);
        let stock = Stock::read(&parse_stock(&text).unwrap(), part, &up, LengthUnit::Mm).unwrap();
        let (lower, upper) = stock.mesh.bounds().unwrap();
        assert!(lower.distance(DVec3::new(0.0, 1.0, 1.0)) < 1e-9, "{lower}");
        assert!(upper.distance(DVec3::new(25.4, 26.4, 26.4)) < 1e-9, "{upper}");
    }

    #[test]
    fn a_fixture_has_its_own_set_up() {
        let read = |text: &str| FixtureMesh::read(&parse_fixture(text).unwrap(), LengthUnit::Mm);
        let fixture = read("bracket@translate:0,0,5").unwrap();
        assert_eq!(fixture.transform.transform_point3(DVec3::ZERO), DVec3::new(0.0, 0.0, 5.0));
        assert!(parse_fixture("bracket@scale:2").is_err());
        // STL has no unit: it is in the part's.
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("block.stl");
        let facet =
            "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
        std::fs::write(&file, format!("solid block\n{facet}endsolid block\n")).unwrap();
        let text = parse_fixture(&file.display().to_string()).unwrap();
        let block = FixtureMesh::read(&text, LengthUnit::Inch).unwrap();
        assert_eq!(block.body.mesh.bounds(), Some((DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0))));
        assert!(!block.body.unit_is_known);
        // Unless its unit is named, among its steps.
        let named = parse_fixture(&format!("{}@unit:inch; translate:0,0,1", file.display())).unwrap();
        let block = FixtureMesh::read(&named, LengthUnit::Mm).unwrap();
        assert_eq!(block.body.mesh.bounds(), Some((DVec3::ZERO, DVec3::new(25.4, 25.4, 0.0))));
        assert!(block.body.unit_is_known && block.transform == DMat4::from_translation(DVec3::Z));
        assert!(parse_fixture("block.stl@unit:furlong").unwrap_err().contains("furlong"));
        assert!(Part::read(&file.display().to_string(), None, None).is_err());
        let refusal = format!("{:#}", read("nowhere.stl").err().unwrap());
        assert!(refusal.contains("nowhere.stl"), "{refusal}");
    }
}
