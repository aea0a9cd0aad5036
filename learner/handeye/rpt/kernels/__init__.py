"""What is compiled: functions over contiguous arrays that validate nothing and raise nothing."""
