"""Plans whose steps last as long as they like: is every window kept, and by which policy?"""
