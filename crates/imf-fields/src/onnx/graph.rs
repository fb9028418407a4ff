//! A graph that grows operation by operation; values are known by name.

use half::f16;

use super::messages::{
    ATTRIBUTE_INT, AttributeProto, Dimension, FLOAT, FLOAT16, GraphProto, INT64, NodeProto, TensorProto,
    TensorShapeProto, TensorType, TypeProto, ValueInfoProto,
};
use crate::tensor_file::{little_endian, little_endian_halves};

/// The name of an input, a constant or an operation's result.
#[derive(Clone, Debug)]
pub(super) struct Value(String);

/// Operations and constants.
#[derive(Default)]
pub(super) struct Graph {
    proto: GraphProto,
}

impl Graph {
    /// An input `[poses, columns]` in single precision.
    pub(super) fn input(&mut self, name: &str, columns: i64, meaning: &str) -> Value {
        self.proto.input.push(described(name, Some(columns), meaning));
        Value(name.into())
    }

    /// Weights under a name of their own.
    pub(super) fn weights(&mut self, name: &str, dims: &[usize], values: &[f32]) -> Value {
        self.constant(name.into(), dims, FLOAT, little_endian(values).into_owned())
    }

    /// Weights in half precision; what reads them casts them.
    pub(super) fn halves(&mut self, name: &str, dims: &[usize], values: &[f16]) -> Value {
        self.constant(name.into(), dims, FLOAT16, little_endian_halves(values).into_owned())
    }

    /// Small numbers.
    pub(super) fn numbers(&mut self, dims: &[usize], values: &[f32]) -> Value {
        let name = format!("constant_{}", self.proto.initializer.len());
        self.constant(name, dims, FLOAT, little_endian(values).into_owned())
    }

    /// One number.
    pub(super) fn number(&mut self, value: f64) -> Value {
        self.numbers(&[], &[value as f32])
    }

    /// Small integers.
    pub(super) fn integers(&mut self, dims: &[usize], values: &[i64]) -> Value {
        let name = format!("constant_{}", self.proto.initializer.len());
        self.constant(name, dims, INT64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn constant(&mut self, name: String, dims: &[usize], data_type: i32, raw_data: Vec<u8>) -> Value {
        let dims = dims.iter().map(|&n| n as i64).collect();
        self.proto.initializer.push(TensorProto { dims, data_type, name: name.clone(), raw_data });
        Value(name)
    }

    /// The result of an operation.
    pub(super) fn op(&mut self, kind: &str, inputs: &[&Value]) -> Value {
        self.op_with(kind, inputs, &[])
    }

    /// The result of an operation with integer attributes.
    pub(super) fn op_with(&mut self, kind: &str, inputs: &[&Value], attributes: &[(&str, i64)]) -> Value {
        let name = format!("{}_{}", kind.to_lowercase(), self.proto.node.len());
        let attribute =
            |&(name, i): &(&str, i64)| AttributeProto { name: name.into(), i, r#type: ATTRIBUTE_INT };
        self.proto.node.push(NodeProto {
            input: inputs.iter().map(|value| value.0.clone()).collect(),
            output: vec![name.clone()],
            name: name.clone(),
            op_type: kind.into(),
            attribute: attributes.iter().map(attribute).collect(),
        });
        Value(name)
    }

    pub(super) fn add(&mut self, a: &Value, b: &Value) -> Value {
        self.op("Add", &[a, b])
    }

    pub(super) fn sub(&mut self, a: &Value, b: &Value) -> Value {
        self.op("Sub", &[a, b])
    }

    pub(super) fn mul(&mut self, a: &Value, b: &Value) -> Value {
        self.op("Mul", &[a, b])
    }

    /// The sum over the columns of `[poses, columns]`, as `[poses, 1]`.
    pub(super) fn sum_of_columns(&mut self, of: &Value) -> Value {
        let axes = self.integers(&[1], &[1]);
        self.op_with("ReduceSum", &[of, &axes], &[("keepdims", 1)])
    }

    /// Column `index` of `[poses, columns]`, as `[poses, 1]`.
    pub(super) fn column(&mut self, of: &Value, index: i64) -> Value {
        let place = self.integers(&[1], &[index]);
        self.op_with("Gather", &[of, &place], &[("axis", 1)])
    }

    /// 0 in the rows of `[poses, columns]` whose values are finite, NaN in others; `[poses, 1]`.
    pub(super) fn nothing_of(&mut self, of: &Value) -> Value {
        let zero = self.number(0.0);
        let zeros = self.mul(of, &zero);
        self.sum_of_columns(&zeros)
    }

    /// Values with NaN where one of `nothings` is.
    pub(super) fn with_invalid(&mut self, value: &Value, nothings: &[Value]) -> Value {
        nothings.iter().fold(value.clone(), |value, nothing| self.add(&value, nothing))
    }

    /// Values within bounds.
    pub(super) fn clip(&mut self, of: &Value, from: f64, to: f64) -> Value {
        let (from, to) = (self.number(from), self.number(to));
        self.op("Clip", &[of, &from, &to])
    }

    /// The graph whose result is `value`, `[poses, 1]`, as `[poses]`.
    pub(super) fn answering(mut self, name: &str, output: &str, value: &Value, meaning: &str) -> GraphProto {
        let flat = self.integers(&[1], &[-1]);
        let last = self.op("Reshape", &[value, &flat]);
        if let Some(node) = self.proto.node.last_mut() {
            debug_assert_eq!(node.output, [last.0]);
            node.output = vec![output.into()];
        }
        self.proto.output.push(described(output, None, meaning));
        self.proto.name = name.into();
        self.proto
    }
}

/// A value of as many rows as there are poses.
fn described(name: &str, columns: Option<i64>, meaning: &str) -> ValueInfoProto {
    let poses = Dimension { dim_value: None, dim_param: Some("poses".into()) };
    let columns = columns.map(|n| Dimension { dim_value: Some(n), dim_param: None });
    let shape = TensorShapeProto { dim: [poses].into_iter().chain(columns).collect() };
    ValueInfoProto {
        name: name.into(),
        r#type: Some(TypeProto { tensor_type: Some(TensorType { elem_type: FLOAT, shape: Some(shape) }) }),
        doc_string: meaning.into(),
    }
}
