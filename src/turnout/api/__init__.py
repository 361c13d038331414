"""What the public interface adds to the packages below: results that show and save themselves."""
