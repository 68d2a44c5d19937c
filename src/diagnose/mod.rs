//! A base model, records and candidate effects in; what the model lacks, and how sure that is, out.

pub mod effect;
