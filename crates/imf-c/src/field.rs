//! Fields that are opened, described and closed.

use std::ffi::c_char;
use std::path::Path;

use imf_core::field::{ExactField, PoseField};
use imf_core::scene::Scene;
use imf_core::world::Checker;
use imf_fields::calibration::Calibration;
use imf_fields::field::{Field, LoadError, Planner};
use imf_fields::file::FieldFile;

use crate::boundary::{ImfStatus, Refusal, call, close, output, read, read_one, text};
use crate::values::ImfQuantity;

/// A field, opened from a file.
pub struct ImfField {
    pub(crate) poses: Box<dyn PoseField>,
    /// Proves motions, where the field is exact or verified.
    pub(crate) checker: Option<Checker>,
    info: ImfInfo,
}

/// What a field is of. Lengths are in its scene's unit.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImfInfo {
    /// Lower corner of the box in which a model is known: that of the voxels' centres.
    pub lower: [f64; 3],
    /// Upper corner of that box.
    pub upper: [f64; 3],
    /// Edge of a voxel.
    pub pitch: f64,
    /// Millimetres in one unit of length.
    pub unit_in_mm: f64,
    /// Clearance by which holder, shank and cutter of the tool are offset in the file's values.
    pub clearance: [f64; 3],
    /// How deep below the part's surface the cutter may reach; 0 for not at all. Voxels of the part whose centres lie no deeper are no
    /// obstacle to it, in values, decisions and proofs alike.
    pub contact: f64,
    /// True where the file has thresholds for the model's own decisions: without, it returns undecided.
    pub calibrated: bool,
    /// What its values are. An exact field's are overlaps, whatever its file's are.
    pub quantity: ImfQuantity,
    /// What no exact value of that quantity lies below and above; a model's may a little, by its error.
    pub bounds: [f64; 2],
}

impl ImfField {
    fn new(
        poses: impl PoseField + 'static,
        checker: Option<Checker>,
        scene: &Scene,
        calibration: Option<&Calibration>,
    ) -> Self {
        let quantity = poses.quantity();
        let record = &scene.record;
        let grid = record.grid;
        let clearance = record.clearance;
        let info = ImfInfo {
            lower: grid.centre([0; 3]).to_array(),
            upper: grid.centre(grid.dims.map(|n| n - 1)).to_array(),
            pitch: grid.pitch,
            unit_in_mm: record.unit.in_mm(),
            clearance: [clearance.holder, clearance.shank, clearance.cutter],
            contact: record.contact.unwrap_or(0.0),
            calibrated: calibration.is_some(),
            quantity: quantity.into(),
            bounds: quantity.bounds(grid.pitch),
        };
        Self { poses: Box::new(poses), checker, info }
    }
}

fn of_file(error: impl Into<LoadError>) -> Refusal {
    let error: LoadError = error.into();
    Refusal::new(ImfStatus::File, error.to_string())
}

fn verified(field: Planner) -> ImfField {
    let scene = field.model.scene().clone();
    let calibration = field.model.calibration().copied();
    let checker = field.checker.clone();
    ImfField::new(field, Some(checker), &scene, calibration.as_ref())
}

fn exact(path: &Path) -> Result<ImfField, Refusal> {
    let saved = FieldFile::read(path).map_err(of_file)?;
    let scene = saved.scene();
    let field = ExactField::of_scene(scene, &scene.record.clearance).map_err(of_file)?;
    let checker = Checker::of_field(&field, scene.record.unit);
    Ok(ImfField::new(field, Some(checker), scene, saved.calibration()))
}

/// Opens a model whose decisions are proven, as imf_open_verified, from a file that is in memory; messages call it name. The bytes are not
/// needed afterwards. On failure *field is NULL.
///
/// # Safety
/// bytes holds size bytes; name is a text that ends with 0, in UTF-8; field has room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_open_verified_from_memory(
    bytes: *const u8,
    size: usize,
    name: *const c_char,
    field: *mut *mut ImfField,
) -> ImfStatus {
    let opened = |name: &Path| {
        // SAFETY: guaranteed by the caller.
        let bytes = unsafe { read(bytes, size, "bytes") }?;
        let model = Field::from_bytes(bytes, &name.to_string_lossy()).map_err(of_file)?;
        Ok(verified(Planner::new(model).map_err(of_file)?))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { open(name, "name", field, opened) }
}

/// Opens and hands over, or leaves `*field` NULL.
///
/// # Safety
/// As the functions below.
unsafe fn open(
    path: *const c_char,
    what: &str,
    field: *mut *mut ImfField,
    opened: impl FnOnce(&Path) -> Result<ImfField, Refusal>,
) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let place = &mut unsafe { output(field, 1, "field") }?[0];
        place.write(std::ptr::null_mut());
        // SAFETY: guaranteed by the caller.
        let path = unsafe { text(path, what) }?;
        place.write(Box::into_raw(Box::new(opened(Path::new(path))?)));
        Ok(())
    })
}

/// Opens a model of any family: approximate values, gradients, and decisions as good as its calibration. On failure *field
/// is NULL.
///
/// # Safety
/// path is a text that ends with 0, in UTF-8; field has room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_open_model(path: *const c_char, field: *mut *mut ImfField) -> ImfStatus {
    let opened = |path: &Path| {
        let field = Field::load(path).map_err(of_file)?;
        let (scene, calibration) = (field.scene().clone(), field.calibration().copied());
        Ok(ImfField::new(field, None, &scene, calibration.as_ref()))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { open(path, "path", field, opened) }
}

/// Opens a model whose decisions are proven: free only where no solid voxel's centre lies in the scene's true tool, but for those that the
/// cutter may hold by ImfInfo.contact. Values and gradients are the model's. On failure *field is NULL.
///
/// # Safety
/// path is a text that ends with 0, in UTF-8; field has room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_open_verified(path: *const c_char, field: *mut *mut ImfField) -> ImfStatus {
    let opened = |path: &Path| Ok(verified(Planner::load(path).map_err(of_file)?));
    // SAFETY: guaranteed by the caller.
    unsafe { open(path, "path", field, opened) }
}

/// As imf_open_verified, for the true tool offset by the clearance that the file was made with. On failure *field is NULL.
///
/// # Safety
/// path is a text that ends with 0, in UTF-8; field has room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_open_verified_with_clearance(
    path: *const c_char,
    field: *mut *mut ImfField,
) -> ImfStatus {
    let opened = |path: &Path| {
        let model = Field::load(path).map_err(of_file)?;
        let clearance = model.scene().record.clearance;
        Ok(verified(Planner::with_clearance(model, clearance).map_err(of_file)?))
    };
    // SAFETY: guaranteed by the caller.
    unsafe { open(path, "path", field, opened) }
}

/// Opens the exact field of the scene in a model's file: voxels are counted in the scene's tool, offset by the file's
/// clearance where it has one, but for those that the cutter may hold by ImfInfo.contact; the model itself is not used. On failure *field is NULL.
///
/// # Safety
/// path is a text that ends with 0, in UTF-8; field has room for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_open_exact(path: *const c_char, field: *mut *mut ImfField) -> ImfStatus {
    // SAFETY: guaranteed by the caller.
    unsafe { open(path, "path", field, exact) }
}

/// What the field is of.
///
/// # Safety
/// field was opened and not closed; info has room for one.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_info(field: *const ImfField, info: *mut ImfInfo) -> ImfStatus {
    call(|| {
        // SAFETY: guaranteed by the caller.
        let (field, place) = unsafe { (read_one(field, "field")?, output(info, 1, "info")?) };
        place[0].write(field.info);
        Ok(())
    })
}

/// Closes a field; NULL is ignored.
///
/// # Safety
/// field is NULL, or was opened, not closed yet, and no thread calls with it any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn imf_close(field: *mut ImfField) {
    // SAFETY: guaranteed by the caller.
    unsafe { close(field) }
}
