"""What one look-think-move step costs outside rendering and motion."""
