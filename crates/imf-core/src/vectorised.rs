//! SIMD dispatch: an expression compiled for each instruction set, the machine's chosen at run time.
//!
//! pulp compiles a closure for an instruction set by inlining it into a function that has it. A closure that could be
//! called twice is called through a shim, and once its body is large the compiler inlines that no longer: the loop then runs
//! in the plain instructions that every processor has, at a quarter of the speed, and nothing reports it. [`vectorised`] makes a
//! closure that can be called but once, whose body is always inlined.

/// What a closure that can be called but once takes away.
pub struct OnceToken;

/// `vectorised!(arch, expression)`: the expression's value. What it calls must be `#[inline(always)]`, or it stays as it is.
#[macro_export]
#[doc(hidden)]
macro_rules! __vectorised {
    ($arch:expr, $body:expr) => {{
        let once = $crate::vectorised::OnceToken;
        $arch.dispatch(
            #[inline(always)]
            || {
                let _taken = once;
                $body
            },
        )
    }};
}
pub use __vectorised as vectorised;

#[cfg(test)]
mod tests {
    use pulp::Arch;

    use super::vectorised;

    #[test]
    fn an_expression_has_its_value_and_may_change_what_it_borrows() {
        let mut values = [1.0f32; 37];
        let sum = vectorised!(Arch::new(), {
            values.iter_mut().for_each(|value| *value *= 2.0);
            values.iter().sum::<f32>()
        });
        assert_eq!((sum, values[36]), (74.0, 2.0));
    }
}
