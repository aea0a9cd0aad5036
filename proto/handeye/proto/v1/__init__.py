"""Version 1 of the messages: generated from the .proto files beside this file (`make proto`)."""
