//! What stands between C and Rust: statuses and messages, pointers turned into slices, panics caught.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What became of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImfStatus {
    /// It is done.
    Ok = 0,
    /// A pointer that must not be NULL is.
    NullPointer = 1,
    /// An argument that cannot be: a misaligned pointer, an absurd count, no orientation, a path that is not UTF-8.
    Argument = 2,
    /// The file is missing, foreign, newer, damaged, or its tool cannot be used.
    File = 3,
    /// This kind of field, or this tool, does not support the query.
    Unsupported = 4,
    /// The query has no result: a pose that is invalid or too far from an obstacle, ends of a motion whose axes are opposite, a tool that
    /// holds no voxel.
    NoAnswer = 5,
    /// A defect of the library, caught. The field can still be used. Memory that is not there is none: it ends the process, so that whoever
    /// asks for a pitch estimates the voxels, of some 20 bytes each.
    Defect = 6,
}

/// Why a call fails.
#[derive(Debug)]
pub(crate) struct Refusal {
    pub(crate) status: ImfStatus,
    pub(crate) message: String,
}

impl Refusal {
    pub(crate) fn new(status: ImfStatus, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    fn null(what: &str) -> Self {
        Self::new(ImfStatus::NullPointer, format!("{what} is NULL"))
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::new(CString::default());
}

/// The message of the last call of this thread that failed; empty before any. It stays until the thread's next failure or
/// end, and is never NULL.
#[unsafe(no_mangle)]
pub extern "C" fn imf_last_error() -> *const c_char {
    // A thread that is ending has none any more.
    LAST.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// The library's version, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn imf_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// Runs what a call does; failures and panics become a status and this thread's message.
pub(crate) fn call(work: impl FnOnce() -> Result<(), Refusal>) -> ImfStatus {
    // A panic leaves only results half done, which its status invalidates: fields have no state but working memory,
    // which each query overwrites.
    let outcome = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        Err(Refusal::new(
            ImfStatus::Defect,
            format!("a defect of the library: {}", panic_text(panic.as_ref())),
        ))
    });
    let Err(Refusal { status, message }) = outcome else { return ImfStatus::Ok };
    let text = CString::new(message.replace('\0', " ")).unwrap_or_default();
    // Nobody is left to read it where this fails.
    let _ = LAST.try_with(|last| last.replace(text));
    status
}

fn panic_text(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message")
}

/// Refuses what no memory can hold.
fn check<T>(pointer: *const T, count: usize, what: &str) -> Result<(), Refusal> {
    if pointer.is_null() {
        return Err(Refusal::null(what));
    }
    if !pointer.is_aligned() {
        return Err(Refusal::new(ImfStatus::Argument, format!("{what} is not aligned")));
    }
    if count.checked_mul(size_of::<T>()).is_none_or(|bytes| isize::try_from(bytes).is_err()) {
        return Err(Refusal::new(ImfStatus::Argument, format!("{what}: no memory holds {count} of them")));
    }
    Ok(())
}

/// What C gives to be read.
///
/// # Safety
/// `pointer` holds `count` elements that nobody writes for as long as the slice is used.
pub(crate) unsafe fn read<'a, T>(pointer: *const T, count: usize, what: &str) -> Result<&'a [T], Refusal> {
    if count == 0 {
        return Ok(&[]);
    }
    check(pointer, count, what)?;
    // SAFETY: not null, aligned, of a size that can be; the rest is guaranteed by the caller.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// One thing that C gives to be read.
///
/// # Safety
/// As [`read`], of one element.
pub(crate) unsafe fn read_one<'a, T>(pointer: *const T, what: &str) -> Result<&'a T, Refusal> {
    // SAFETY: guaranteed by the caller.
    Ok(&unsafe { read(pointer, 1, what) }?[0])
}

/// One thing of the library that C gives to be changed.
///
/// # Safety
/// `pointer` holds one element that nobody else reads or writes for as long as it is used.
pub(crate) unsafe fn write_one<'a, T>(pointer: *mut T, what: &str) -> Result<&'a mut T, Refusal> {
    check(pointer, 1, what)?;
    // SAFETY: not null, aligned; the rest is guaranteed by the caller.
    Ok(unsafe { &mut *pointer })
}

/// Where C wants results. The memory need not hold anything yet: it is only written.
///
/// # Safety
/// `pointer` has room for `count` elements that nobody else reads or writes for as long as the slice is used.
pub(crate) unsafe fn output<'a, T>(
    pointer: *mut T,
    count: usize,
    what: &str,
) -> Result<&'a mut [MaybeUninit<T>], Refusal> {
    if count == 0 {
        return Ok(&mut []);
    }
    check(pointer, count, what)?;
    // SAFETY: not null, aligned, of a size that can be; the rest is guaranteed by the caller.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer.cast(), count) })
}

/// A text that C gives.
///
/// # Safety
/// `pointer` is NULL or a text that ends with 0.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a str, Refusal> {
    if pointer.is_null() {
        return Err(Refusal::null(what));
    }
    // SAFETY: not null; the end is guaranteed by the caller.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Refusal::new(ImfStatus::Argument, format!("{what} is not text in UTF-8")))
}

/// Closes what was opened or created; NULL is ignored.
///
/// # Safety
/// `opened` is NULL, or was made by `Box::into_raw` and is closed once.
pub(crate) unsafe fn close<T>(opened: *mut T) {
    if !opened.is_null() {
        // Memory is given back; there is nothing to report.
        let _ = call(|| {
            // SAFETY: guaranteed by the caller.
            drop(unsafe { Box::from_raw(opened) });
            Ok(())
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message() -> String {
        // SAFETY: read at once.
        unsafe { CStr::from_ptr(imf_last_error()) }.to_str().unwrap().to_owned()
    }

    #[test]
    fn failures_and_panics_are_told_apart_and_stay_with_their_thread() {
        assert_eq!(message(), "");
        assert_eq!(call(|| Ok(())), ImfStatus::Ok);
        assert_eq!(call(|| Err(Refusal::new(ImfStatus::File, "a\0b"))), ImfStatus::File);
        assert_eq!(message(), "a b");
        assert_eq!(call(|| panic!("of {}", 3)), ImfStatus::Defect);
        assert_eq!(message(), "a defect of the library: of 3");
        assert_eq!(call(|| Ok(())), ImfStatus::Ok);
        assert!(message().ends_with("of 3"));
        std::thread::spawn(|| assert_eq!(message(), "")).join().unwrap();
    }

    #[test]
    fn pointers_that_cannot_be_are_refused() {
        let numbers = [1.0_f32, 2.0];
        let status = |result: Result<&[f32], Refusal>| result.err().map(|refusal| refusal.status);
        // SAFETY: what is accepted is there; what is not is refused before it is read.
        unsafe {
            assert_eq!(read(numbers.as_ptr(), 2, "poses").unwrap(), numbers);
            assert!(read::<f32>(std::ptr::null(), 0, "poses").unwrap().is_empty());
            assert_eq!(status(read(std::ptr::null(), 1, "poses")), Some(ImfStatus::NullPointer));
            let askew = numbers.as_ptr().byte_add(1);
            assert_eq!(status(read(askew, 1, "poses")), Some(ImfStatus::Argument));
            assert_eq!(status(read(numbers.as_ptr(), usize::MAX / 2, "poses")), Some(ImfStatus::Argument));
            assert!(output::<f32>(std::ptr::null_mut(), 0, "values").is_ok());
            assert!(output::<f32>(std::ptr::null_mut(), 1, "values").is_err());
            assert_eq!(text(std::ptr::null(), "path").unwrap_err().status, ImfStatus::NullPointer);
            assert_eq!(text(c"\xff".as_ptr(), "path").unwrap_err().status, ImfStatus::Argument);
        }
    }
}
