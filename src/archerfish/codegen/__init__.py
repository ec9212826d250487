"""Any controller as a C file or an ONNX model, generated from the formulas that run here."""
